"""Every trajectory is a position whose velocity and acceleration are its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np

from tests.enrolled import assert_finite, assert_float_leaves, every
from tests.motions.members import LIKE_OTHERS, TRAJECTORIES

TIMES = jnp.asarray(np.random.default_rng(0).uniform(0.01, 4.0, 60))
EVERY = every("trajectory", TRAJECTORIES, full=LIKE_OTHERS)


@EVERY
def test_velocity_and_acceleration_match_differences_of_the_position(trajectory):
    reference = jax.jit(jax.vmap(trajectory.reference))(TIMES)
    position = jax.jit(jax.vmap(trajectory.position))
    h = 1e-4
    before, now, after = position(TIMES - h), position(TIMES), position(TIMES + h)
    np.testing.assert_allclose(reference.q, now, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(reference.dq, (after - before) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(reference.ddq, (after - 2 * now + before) / h**2, atol=2e-3)


@EVERY
def test_the_acceleration_is_the_derivative_of_the_velocity(trajectory):
    reference = jax.jit(jax.vmap(trajectory.reference))
    h = 1e-6
    difference = (reference(TIMES + h).dq - reference(TIMES - h).dq) / (2 * h)
    np.testing.assert_allclose(reference(TIMES).ddq, difference, atol=1e-6)


@EVERY
def test_all_parameters_are_differentiable_leaves(trajectory):
    assert_float_leaves(trajectory)
    assert_finite(jax.jit(jax.grad(lambda trajectory: jnp.sum(trajectory.position(jnp.asarray(0.8)))))(trajectory))


@EVERY
def test_the_motion_is_finite_from_the_start_to_long_after(trajectory):
    assert_finite(jax.jit(jax.vmap(trajectory.reference))(jnp.array([0.0, 1e-12, 1.0, 1e3])))
