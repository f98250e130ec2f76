"""What every disturbance must be: a force that adds up and scales."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from slidax.disturbances import Constant
from tests.disturbances.members import DISTURBANCES
from tests.enrolled import every

rng = np.random.default_rng(0)
TIMES = jnp.asarray(rng.uniform(0.0, 3.0, 40))
STATES = jax.vmap(State)(*jnp.asarray(rng.normal(size=(2, 40, 2))))


def force(disturbance):
    return np.asarray(jax.vmap(disturbance)(TIMES, STATES))


@every("disturbance", DISTURBANCES)
def test_two_disturbances_add(disturbance):
    other = Constant([0.25, -4.0])
    np.testing.assert_allclose(force(disturbance + other), force(disturbance) + force(other), rtol=1e-15)
    np.testing.assert_allclose(force(other + disturbance), force(disturbance) + force(other), rtol=1e-15)


@every("disturbance", DISTURBANCES)
def test_a_disturbance_scales_from_both_sides(disturbance):
    np.testing.assert_array_equal(force(2.5 * disturbance), 2.5 * force(disturbance))
    np.testing.assert_array_equal(force(disturbance * 2.5), 2.5 * force(disturbance))
    assert np.any(force(disturbance) != 0)


@every("disturbance", DISTURBANCES)
def test_the_factor_zero_switches_it_off(disturbance):
    np.testing.assert_array_equal(force(0.0 * disturbance), 0.0)


@every("disturbance", DISTURBANCES)
def test_one_force_per_joint_and_finite_gradients_by_every_parameter(disturbance):
    state = State(q=jnp.zeros(2), dq=jnp.zeros(2))

    def total(disturbance):
        tau = disturbance(jnp.asarray(1.0), state)
        assert tau.shape == (2,)
        return jnp.sum(tau)

    leaves = jax.tree.leaves(disturbance)
    assert leaves
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in leaves)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(jax.grad(total)(disturbance)))
