"""Each disturbance against its own formula."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.types import State
from slidax.plant import Friction, Step, Sum


def at_rest(n):
    return State(q=jnp.zeros(n), dq=jnp.zeros(n))


def test_friction_opposes_the_velocity_and_takes_energy():
    friction = Friction([0.3, 0.2], [0.1, 0.0], 0.02)
    dq = jnp.asarray(np.random.default_rng(0).normal(size=(100, 2)))
    tau = jax.vmap(lambda dq: friction(jnp.asarray(0.0), State(q=jnp.zeros(2), dq=dq)))(dq)
    assert np.all(np.asarray(tau * dq) < 0)


def test_friction_is_smoothed_coulomb_plus_viscous_and_none_at_rest():
    friction = Friction([0.3, 0.2, 0.3], [0.1, 0.05, 0.0], 0.01)
    moving = State(q=jnp.zeros(3), dq=jnp.array([2.0, -3.0, 0.01]))
    np.testing.assert_allclose(friction(jnp.asarray(0.0), moving), [-0.5, 0.35, -0.3 * np.tanh(1.0)], rtol=1e-14)
    np.testing.assert_array_equal(friction(jnp.asarray(0.0), at_rest(3)), np.zeros(3))


def test_step_includes_its_start_and_excludes_its_end():
    step = Step([3.0, -1.0], 0.5, 1.5)
    for t, factor in ((0.0, 0), (np.nextafter(0.5, 0), 0), (0.5, 1), (1.49, 1), (1.5, 0), (9.0, 0)):
        np.testing.assert_array_equal(step(jnp.asarray(t), at_rest(2)), np.array([3.0, -1.0]) * factor)
    np.testing.assert_array_equal(Step([2.0], 0.5)(jnp.asarray(1e9), at_rest(1)), [2.0])


def test_an_empty_sum_is_no_force():
    np.testing.assert_array_equal(Sum(())(jnp.asarray(0.0), at_rest(3)), np.zeros(3))
