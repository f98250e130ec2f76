"""What every reaching law must be: a push along s that vanishes with it, and a direction no longer than one."""

import jax
import jax.numpy as jnp
import numpy as np

from tests.enrolled import every
from tests.reaching.members import REACHING

S = jnp.asarray(np.random.default_rng(0).normal(size=(200, 2)) * np.logspace(-6, 2, 200)[:, None])


@every("reaching", REACHING)
def test_power_and_direction_push_along_s(reaching):
    for part in (reaching.power, reaching.direction):
        pushed = np.asarray(jax.jit(jax.vmap(part))(S))
        assert np.all(np.sum(np.asarray(S) * pushed, axis=1) > 0)
        np.testing.assert_allclose(jax.vmap(part)(-S), -pushed, rtol=1e-13)


@every("reaching", REACHING)
def test_the_direction_is_no_longer_than_one_and_parallel_to_s(reaching):
    direction = np.asarray(jax.vmap(reaching.direction)(S))
    assert np.all(np.linalg.norm(direction, axis=1) <= 1 + 1e-15)
    cross = direction[:, 0] * np.asarray(S)[:, 1] - direction[:, 1] * np.asarray(S)[:, 0]
    np.testing.assert_allclose(cross, 0.0, atol=1e-14 * np.linalg.norm(S, axis=1).max())


@every("reaching", REACHING)
def test_at_zero_both_are_zero_with_finite_gradients(reaching):
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in jax.tree.leaves(reaching))
    for name in ("power", "direction"):

        def total(reaching, s, name=name):
            return jnp.sum(getattr(reaching, name)(s))

        np.testing.assert_array_equal(getattr(reaching, name)(jnp.zeros(2)), 0.0)
        gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(reaching, jnp.zeros(2))
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradients))
