"""The smooth power (29) against the paper's printed coefficients (30)-(32) and slope (33)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slidax.core import smooth_power, smooth_power_and_slope

EXPONENTS = [0.1, 0.5, 0.9]
WIDTHS = [0.01, 0.3, 1.0]
exponents = st.floats(0.05, 0.95)
widths = st.floats(1e-3, 1.0)
errors = st.floats(-20.0, 20.0)


def coefficients(p: float, delta: float) -> tuple[float, float, float]:
    """(30)-(32), as printed."""
    l1 = (p**2 / 2 - 5 * p / 2 + 3) * delta ** (p - 1)
    l2 = (-(p**2) + 4 * p - 3) * delta ** (p - 2)
    l3 = (p**2 / 2 - 3 * p / 2 + 1) * delta ** (p - 3)
    return l1, l2, l3


def printed(x: float, p: float, delta: float) -> float:
    """(29), as printed."""
    if abs(x) >= delta:
        return abs(x) ** p * np.sign(x)
    l1, l2, l3 = coefficients(p, delta)
    return l1 * x + l2 * abs(x) ** 2 * np.sign(x) + l3 * x**3


def printed_slope(x: float, p: float, delta: float) -> float:
    """(33), as printed."""
    if abs(x) >= delta:
        return p * abs(x) ** (p - 1)
    l1, l2, l3 = coefficients(p, delta)
    return l1 + 2 * l2 * abs(x) + 3 * l3 * x**2


def smooth_power_slope(x, p, delta):
    return smooth_power_and_slope(x, p, delta)[1]


compiled = jax.jit(smooth_power)
compiled_slope = jax.jit(smooth_power_slope)
gradients = jax.jit(jax.grad(smooth_power, argnums=(0, 1, 2)))


def value(x: float, p: float, delta: float) -> float:
    return float(compiled(x, p, delta))


def slope(x: float, p: float, delta: float) -> float:
    return float(compiled_slope(x, p, delta))


@given(errors, exponents, widths)
def test_the_smooth_power_is_the_printed_one(x, p, delta):
    assert value(x, p, delta) == pytest.approx(printed(x, p, delta), rel=1e-12, abs=1e-300)


@given(st.floats(-1.5, 1.5), exponents, widths)
def test_inside_the_core_the_smooth_power_is_the_printed_cubic(z, p, delta):
    x = z * delta
    assert value(x, p, delta) == pytest.approx(printed(x, p, delta), rel=1e-12, abs=1e-300)


@given(st.floats(-3.0, 3.0), exponents, widths)
def test_the_slope_is_the_printed_one(z, p, delta):
    x = z * delta
    assert slope(x, p, delta) == pytest.approx(printed_slope(x, p, delta), rel=1e-11)


@given(st.floats(-3.0, 3.0), exponents, widths)
def test_the_slope_is_the_derivative(z, p, delta):
    derivative, _, _ = gradients(z * delta, p, delta)
    assert float(derivative) == pytest.approx(slope(z * delta, p, delta), rel=1e-11)


@pytest.mark.parametrize("p", EXPONENTS)
@pytest.mark.parametrize("delta", WIDTHS)
def test_the_core_meets_the_power_with_its_value_and_slope_at_delta(p, delta):
    l1, l2, l3 = coefficients(p, delta)
    inside = l1 * delta + l2 * delta**2 + l3 * delta**3
    inside_slope = l1 + 2 * l2 * delta + 3 * l3 * delta**2
    assert value(delta, p, delta) == pytest.approx(inside, rel=1e-12)
    assert slope(delta, p, delta) == pytest.approx(inside_slope, rel=1e-12)
    just_inside = delta * (1 - 1e-9)
    assert value(just_inside, p, delta) == pytest.approx(delta**p, rel=1e-8)
    assert slope(just_inside, p, delta) == pytest.approx(p * delta ** (p - 1), rel=1e-8)


@pytest.mark.parametrize("p", EXPONENTS)
@pytest.mark.parametrize("delta", WIDTHS)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_second_derivative_too_is_continuous_at_delta(p, delta, side):
    second = jax.grad(lambda x: smooth_power_slope(x, jnp.asarray(p), jnp.asarray(delta)))
    expected = side * p * (p - 1) * delta ** (p - 2)
    for near in (1 - 1e-9, 1 + 1e-9):
        assert float(second(jnp.asarray(side * delta * near))) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("p", EXPONENTS)
@pytest.mark.parametrize("delta", WIDTHS)
def test_the_smooth_power_is_odd_and_increasing(p, delta):
    x = jnp.linspace(-3 * delta, 3 * delta, 601)
    y = np.asarray(smooth_power(x, jnp.asarray(p), jnp.asarray(delta)))
    assert np.array_equal(y, -smooth_power(-x, jnp.asarray(p), jnp.asarray(delta)))
    assert np.all(np.diff(y) > 0)
    assert np.all(np.asarray(smooth_power_slope(x, jnp.asarray(p), jnp.asarray(delta))) > 0)


def test_the_smooth_power_keeps_zero_and_units():
    assert value(0.0, 0.5, 0.01) == 0.0
    assert value(1.0, 0.5, 0.01) == 1.0
    assert value(-1.0, 0.5, 0.01) == -1.0


@pytest.mark.parametrize("x", [0.0, 1e-320, 1e-8, 0.01, -0.01, 0.02, 1e6])
@pytest.mark.parametrize("function", [smooth_power, smooth_power_slope])
def test_all_gradients_are_finite_everywhere(x, function):
    arguments = (jnp.asarray(x), jnp.asarray(0.5), jnp.asarray(0.01))
    assert np.all(np.isfinite(jax.grad(function, argnums=(0, 1, 2))(*arguments)))


@given(st.floats(-3.0, 3.0), exponents, widths)
def test_gradients_by_the_exponent_and_the_width_match_differences(z, p, delta):
    x = z * delta
    _, by_p, by_delta = gradients(x, p, delta)
    h = 1e-6
    scale = max(1.0, delta ** (p - 1))
    difference = (printed(x, p + h, delta) - printed(x, p - h, delta)) / (2 * h)
    assert float(by_p) == pytest.approx(difference, rel=1e-5, abs=1e-6 * scale)
    if abs(abs(x) - delta) > 1e-4 * delta:
        k = 1e-6 * delta
        difference = (printed(x, p, delta + k) - printed(x, p, delta - k)) / (2 * k)
        assert float(by_delta) == pytest.approx(difference, rel=1e-4, abs=1e-6 * scale)
