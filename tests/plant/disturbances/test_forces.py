"""Each disturbance against its own formula."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.types import State
from slidax.plant import Friction, Ripple, Step, Stribeck, Sum


def at_rest(n):
    return State(q=jnp.zeros(n), dq=jnp.zeros(n))


def test_friction_opposes_the_velocity_and_takes_energy():
    friction = Friction([0.3, 0.2], [0.1, 0.0], 0.02)
    dq = jnp.asarray(np.random.default_rng(0).normal(size=(100, 2)))
    tau = jax.vmap(lambda dq: friction(jnp.asarray(0.0), State(q=jnp.zeros(2), dq=dq)))(dq)
    assert np.all(np.asarray(tau * dq) < 0)


def test_friction_is_smoothed_coulomb_plus_viscous_and_zero_at_rest():
    friction = Friction([0.3, 0.2, 0.3], [0.1, 0.05, 0.0], 0.01)
    moving = State(q=jnp.zeros(3), dq=jnp.array([2.0, -3.0, 0.01]))
    np.testing.assert_allclose(friction(jnp.asarray(0.0), moving), [-0.5, 0.35, -0.3 * np.tanh(1.0)], rtol=1e-14)
    np.testing.assert_array_equal(friction(jnp.asarray(0.0), at_rest(3)), np.zeros(3))


def test_stribeck_term_is_the_full_excess_at_low_speed_and_vanishes_at_high_speed():
    stribeck = Stribeck([0.3, 0.2], [0.05, 0.1], 1e-4)
    for dq, expected in (
        ([1e-3, -1e-3], [-0.3, 0.2]),
        ([0.05, 0.1], [-0.3 / np.e, -0.2 / np.e]),
        ([1.0, -2.0], [0, 0]),
    ):
        tau = stribeck(jnp.asarray(0.0), State(q=jnp.zeros(2), dq=jnp.array(dq)))
        np.testing.assert_allclose(tau, expected, rtol=1e-3, atol=1e-15)
    np.testing.assert_array_equal(stribeck(jnp.asarray(0.0), at_rest(2)), np.zeros(2))


def test_ripple_has_its_number_of_periods_per_turn_and_zero_mean():
    ripple = Ripple([0.5, 0.2], [30.0, 200.0], [0.0, 0.7])
    q = np.linspace(0.0, 2.0 * np.pi, 12001)[:-1, None] * np.ones(2)
    tau = np.asarray(jax.vmap(lambda q: ripple(jnp.asarray(0.0), State(q=q)))(jnp.asarray(q)))
    np.testing.assert_allclose(tau.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(tau).max(axis=0), [0.5, 0.2], rtol=1e-3)
    for joint, periods in enumerate((30, 200)):
        assert np.argmax(np.abs(np.fft.rfft(tau[:, joint]))) == periods


def test_step_includes_its_start_and_excludes_its_end():
    step = Step([3.0, -1.0], 0.5, 1.5)
    for t, factor in ((0.0, 0), (np.nextafter(0.5, 0), 0), (0.5, 1), (1.49, 1), (1.5, 0), (9.0, 0)):
        np.testing.assert_array_equal(step(jnp.asarray(t), at_rest(2)), np.array([3.0, -1.0]) * factor)
    np.testing.assert_array_equal(Step([2.0], 0.5)(jnp.asarray(1e9), at_rest(1)), [2.0])


def test_an_empty_sum_of_disturbances_has_zero_force():
    np.testing.assert_array_equal(Sum(())(jnp.asarray(0.0), at_rest(3)), np.zeros(3))
