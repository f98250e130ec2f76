"""Recursive least squares over windows of samples: motion and noise of a window, estimates and covariances."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.law.least_squares import (
    KINDS,
    NOISE,
    QUARTERS,
    Window,
    diagonal_covariance,
    measured_once,
    moved_along,
    next_windows,
    places,
    quadratic_form,
    window_noise,
    window_sums,
    with_drift,
)

RNG = np.random.default_rng(3)


def windows(samples, period, position, torque, count):
    sums = jnp.zeros((QUARTERS, KINDS, 1))
    for k in range(count):
        signals = [jnp.array([value]) for value in (position(k * period), torque((k - 0.5) * period), 1.0, k * period)]
        sums = window_sums(sums, jnp.asarray(float(k % samples)), samples, jnp.asarray(period), *signals)
        if k % samples == samples - 1:
            if k >= QUARTERS * samples - 1:
                yield k, Window.of(sums)
            sums = next_windows(sums)


@pytest.mark.parametrize(("samples", "period"), [(10, 1e-3), (5, 2e-3), (3, 5e-3)])
def test_a_window_returns_motion_and_torque_at_its_midpoint(samples, period):
    def position(t):
        return 0.3 + 2.0 * t - 5.0 * t * t

    for k, window in windows(samples, period, position, lambda t: 4.0 * t, 6 * samples):
        middle = (k - 0.5 * (QUARTERS * samples - 1)) * period
        np.testing.assert_allclose(window.second, middle, atol=1e-14)
        np.testing.assert_allclose(window.tau, 4.0 * middle, atol=1e-4)
        np.testing.assert_allclose(window.dq, 2.0 - 10.0 * middle, rtol=1e-9)
        np.testing.assert_allclose(window.ddq, -10.0, rtol=1e-9)
        # A smoothed parabola is higher by its curvature times half the kernel's variance.
        assert 0 < position(middle) - window.q[0] < 5.0 * (QUARTERS * samples * period) ** 2 / 12


def full(covariance, size):
    return np.asarray(covariance)[places(size)[2]]


def test_scalar_measurements_give_the_least_squares_solution():
    true, rows = RNG.normal(size=6), RNG.normal(size=(40, 6))
    y = rows @ true + 0.1 * RNG.normal(size=40)
    parameters, covariance = jnp.zeros(6), diagonal_covariance(jnp.full(6, 9.0))
    for row, value in zip(rows, y, strict=True):
        parameters, covariance = measured_once(parameters, covariance, jnp.asarray(row), value, jnp.asarray(0.01))
    information = rows.T @ rows / 0.01 + np.eye(6) / 9.0
    np.testing.assert_allclose(full(covariance, 6), np.linalg.inv(information), rtol=1e-9)
    np.testing.assert_allclose(parameters, np.linalg.solve(information, rows.T @ y / 0.01), rtol=1e-9)
    np.testing.assert_allclose(
        quadratic_form(covariance, jnp.asarray(rows[0])), rows[0] @ full(covariance, 6) @ rows[0]
    )


def test_a_constraint_is_met_without_changing_the_measured_combination():
    parameters, covariance = jnp.zeros(3), diagonal_covariance(jnp.ones(3))
    measured = jnp.array([1.0, 1.0, 0.0])
    parameters, covariance = measured_once(parameters, covariance, measured, jnp.asarray(1.0), jnp.asarray(1e-8))
    moved = moved_along(parameters, covariance, jnp.array([1.0, 0.0, 0.0]), jnp.asarray(0.3))
    np.testing.assert_allclose(moved, [0.8, 0.2, 0.0], atol=1e-6)


def test_variances_stay_below_their_bound_and_the_matrix_positive_definite():
    covariance = diagonal_covariance(jnp.array([1.0, 4.0, 0.1]))
    row = jnp.array([1.0, -2.0, 3.0])
    for _ in range(200):
        _, covariance = measured_once(jnp.zeros(3), covariance, row, jnp.asarray(0.0), jnp.asarray(1e-4))
        covariance = with_drift(covariance, jnp.full(3, 0.1), jnp.array([1.0, 2.0, 3.0]))
    matrix = full(covariance, 3)
    assert np.all(np.diagonal(matrix) <= np.array([1.0, 2.0, 3.0]) * (1 + 1e-12))
    assert np.linalg.eigvalsh(matrix).min() > 0.01


@pytest.mark.parametrize(("samples", "period"), [(10, 1e-3), (5, 2e-3), (3, 4e-3)])
def test_noise_of_a_window_grows_with_the_inertia_and_with_the_encoders_noise(samples, period):
    deviation, inertias = np.array([1e-5, 4e-5]), np.array([50.0, 20.0])
    expected = window_noise(np.diag(inertias), deviation, samples, period)
    rng, nothing = np.random.default_rng(0), jnp.zeros(400)

    @jax.jit
    def sampled(sums, slot, q):
        return window_sums(sums, slot, samples, jnp.asarray(period), q, nothing, nothing, nothing)

    for joint in range(2):
        sums = jnp.zeros((QUARTERS, KINDS, 400))
        for quarter in range(QUARTERS):
            for slot in range(samples):
                sums = sampled(sums, jnp.asarray(float(slot)), jnp.asarray(deviation[joint] * rng.standard_normal(400)))
            sums = sums if quarter == QUARTERS - 1 else next_windows(sums)
        torque = inertias[joint] * np.asarray(Window.of(sums).ddq)
        np.testing.assert_allclose(np.std(torque), expected[joint], rtol=0.15)
    light = window_noise(np.diag([0.01, 50.0]), 1e-5, samples, period)
    assert light[0] == NOISE and light[1] == expected[0]
