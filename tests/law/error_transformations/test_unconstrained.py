"""Without an envelope the transformed error is the error."""

import jax.numpy as jnp
import numpy as np

from slidax.law import Unconstrained


def test_the_error_and_its_rate_pass_through_and_no_envelope_is_promised():
    transformation = Unconstrained()
    e, de = jnp.array([0.3, -0.2]), jnp.array([1.0, 0.0])
    memory = transformation.init(jnp.zeros(()), e)
    error = transformation(jnp.ones(()), e, de, memory)
    np.testing.assert_array_equal(error.eps1, e)
    np.testing.assert_array_equal(error.eps2, de)
    np.testing.assert_array_equal(error.beta, 1.0)
    np.testing.assert_array_equal(error.alpha, 0.0)
    np.testing.assert_array_equal(error.alpha_rate, 0.0)
    assert memory == ()
    assert transformation.envelope(jnp.ones(()), memory) is None
