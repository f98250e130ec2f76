"""Performance functions against (20), (B5) and closed second derivatives; Proposition 3."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slidax.law import Exponential, FiniteTime, FixedTime


def closed(t, initial, final, deadline, exponent):
    """ρ of (20), ρ̇ of (B5), and ρ̈."""
    if t >= deadline:
        return final, 0.0, 0.0
    z, width = 1 - t / deadline, initial - final
    return (
        width * z**exponent + final,
        -(exponent / deadline) * width * z ** (exponent - 1),
        exponent * (exponent - 1) / deadline**2 * width * z ** (exponent - 2),
    )


all_three = jax.jit(lambda performance, t: performance.radius_rate_curvature(t))


@given(st.floats(0.0, 8.0), st.floats(0.1, 100.0), st.floats(1e-3, 0.09), st.floats(0.5, 7.0), st.floats(2.001, 5.0))
def test_radius_rate_and_curvature_agree_with_closed_forms(t, initial, final, deadline, exponent):
    computed = all_three(FixedTime(initial, final, deadline, exponent), t)
    for value, expected in zip(computed, closed(t, initial, final, deadline, exponent), strict=True):
        assert float(value) == pytest.approx(expected, rel=1e-9, abs=1e-12 * initial)


@pytest.mark.parametrize("deadline", [2.0, 5.0])
@pytest.mark.parametrize("initial", [0.5, 100.0])
def test_the_curves_of_figure_1_settle_at_their_deadline(initial, deadline):
    performance = FixedTime(initial, 0.01, deadline, 2.01)
    assert float(performance.radius(jnp.asarray(0.0))) == pytest.approx(initial, rel=1e-15)
    assert float(performance.radius(jnp.asarray(0.99 * deadline))) > 0.01
    for t in (deadline, deadline + 1e-9, 2 * deadline):
        rho, rate, curvature = performance.radius_rate_curvature(jnp.asarray(t))
        assert (float(rho), float(rate), float(curvature)) == (0.01, 0.0, 0.0)


@given(st.floats(1e-12, 1e-3), st.floats(2.01, 4.0))
def test_two_derivatives_are_continuous_at_the_deadline(before, exponent):
    """They vanish like the powers σ - 1 and σ - 2 of the distance to T."""
    performance = FixedTime(0.8, 0.002, 5.0, exponent)
    _, rate, curvature = all_three(performance, 5.0 * (1 - before))
    assert abs(float(rate)) <= 1.001 * exponent / 5.0 * 0.8 * before ** (exponent - 1)
    assert abs(float(curvature)) <= 1.001 * exponent * (exponent - 1) / 25.0 * 0.8 * before ** (exponent - 2)


@pytest.mark.parametrize("t", [4.999999999999999, 5.0, 5.000000000000001])
def test_radius_rate_and_curvature_are_finite_around_the_deadline(t):
    performance = FixedTime([0.8, 0.6], 0.002, [5.0, 5.0], 2.01)
    values = performance.radius_rate_curvature(jnp.asarray(t))
    jerk = jax.jacfwd(lambda t: performance.radius_rate_curvature(t)[2])(jnp.asarray(t))
    assert np.all(np.isfinite(np.asarray([*values, jerk])))


def test_the_exponential_function_and_two_derivatives_agree_with_closed_forms():
    performance = Exponential([0.8, 0.6], 0.002, [1.0, 2.0])
    width, rate = np.array([0.798, 0.598]), np.array([1.0, 2.0])
    decay = np.exp(-rate * 0.7)
    expected = (width * decay + 0.002, -rate * width * decay, rate**2 * width * decay)
    for value, closed_form in zip(performance.radius_rate_curvature(jnp.asarray(0.7)), expected, strict=True):
        np.testing.assert_allclose(value, closed_form, rtol=1e-13)


def test_the_finite_time_function_solves_its_differential_equation():
    performance = FiniteTime(0.8, 0.002, 0.5, 0.6)
    for t in np.linspace(0.0, float(performance.deadline) * 0.99, 20):
        rho, rate, _ = performance.radius_rate_curvature(jnp.asarray(t))
        assert float(rate) == pytest.approx(-0.5 * (float(rho) - 0.002) ** 0.6, rel=1e-9)


def test_the_finite_time_function_settles_at_its_deadline_which_grows_with_the_initial_radius():
    near, far = FiniteTime(0.8, 0.002, 0.5, 0.6), FiniteTime(8.0, 0.002, 0.5, 0.6)
    assert float(near.deadline) < float(far.deadline)
    for performance in (near, far):
        assert float(performance.radius(performance.deadline * 0.999)) > 0.002
        assert float(performance.radius(performance.deadline * 1.000001)) == 0.002
