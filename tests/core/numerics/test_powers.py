"""Powers of the paper and of its rivals: values, slopes and derivatives that are finite everywhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slidax.core import (
    linear_core_power_and_slope,
    power,
    saturation,
    sig,
    sig_and_slope,
    smooth_power,
    smooth_power_and_slope,
    two_term_power_and_slope,
    unit_vector,
)

exponents = st.floats(0.05, 0.95)
widths = st.floats(1e-3, 1.0)
cores = st.floats(1.05, 3.0)
# In core widths, without the edge, where the linear core has a kink.
places = st.floats(-3.0, 3.0).filter(lambda z: abs(abs(z) - 1) > 1e-6 and (z == 0 or abs(z) > 1e-6))

linear_core = jax.jit(linear_core_power_and_slope)
two_term = jax.jit(two_term_power_and_slope)


@given(places, exponents, widths)
def test_the_linear_core_power_agrees_with_the_printed_formula(z, p, delta):
    x = z * delta
    outside = abs(x) >= delta
    value, slope = linear_core(x, p, delta)
    assert float(value) == pytest.approx(abs(x) ** p * np.sign(x) if outside else delta ** (p - 1) * x, rel=1e-12)
    assert float(slope) == pytest.approx(p * abs(x) ** (p - 1) if outside else delta ** (p - 1), rel=1e-12)


def test_the_linear_core_power_is_continuous_at_its_edge_and_its_slope_jumps():
    inside, inner = linear_core(0.01 * (1 - 1e-12), 0.5, 0.01)
    edge, outer = linear_core(0.01, 0.5, 0.01)
    assert float(inside) == pytest.approx(0.1, rel=1e-11)
    assert float(edge) == pytest.approx(0.1, rel=1e-12)
    assert float(inner) == pytest.approx(10.0, rel=1e-12)
    assert float(outer) == pytest.approx(5.0, rel=1e-12)


@given(places, exponents, cores, widths)
def test_the_two_term_power_and_its_slope_agree_with_the_printed_equations(z, a, r, delta):
    x = z * delta
    l1, l2 = (r - a) / (r - 1) * delta ** (a - 1), (a - 1) / (r - 1) * delta ** (a - r)
    value, slope = two_term(x, a, r, delta)
    if abs(x) >= delta:
        expected, expected_slope = abs(x) ** a * np.sign(x), a * abs(x) ** (a - 1)
    else:
        expected = l1 * x + l2 * abs(x) ** r * np.sign(x)
        expected_slope = l1 + r * l2 * abs(x) ** (r - 1)
    assert float(value) == pytest.approx(expected, rel=1e-9)
    assert float(slope) == pytest.approx(expected_slope, rel=1e-9)


@pytest.mark.parametrize("x", [0.0, -0.0, 1e-320, -1e-12, 1e-8, 0.01, -0.01, 0.02, 0.3, 1e6, 1e12])
@pytest.mark.parametrize("part", [0, 1])
def test_powers_and_slopes_have_finite_gradients_everywhere(x, part):
    p, r, delta = (jnp.asarray(v) for v in (0.5, 1.7, 0.01))
    powers = [(linear_core, (p, delta)), (two_term, (p, r, delta)), (sig_and_slope, (jnp.asarray(1.2),))]
    for function, arguments in (*powers, (smooth_power_and_slope, (p, delta))):
        by = jax.grad(lambda *a: function(*a)[part], argnums=tuple(range(len(arguments) + 1)))  # noqa: B023
        assert np.isfinite(function(jnp.asarray(x), *arguments)[part])
        assert np.all(np.isfinite(by(jnp.asarray(x), *arguments)))


def test_saturation_is_linear_inside_its_layer_and_the_sign_outside():
    x = jnp.array([-2.0, -0.05, -0.02, 0.0, 0.02, 0.05, 2.0])
    np.testing.assert_allclose(saturation(x, jnp.asarray(0.05)), [-1, -1, -0.4, 0, 0.4, 1, 1], rtol=1e-14)
    np.testing.assert_array_equal(saturation(x, jnp.asarray(0.0)), np.sign(x))
    slopes = jax.grad(lambda x, w: jnp.sum(saturation(x, w)), argnums=(0, 1))
    for width in (0.0, 0.05):
        assert all(np.all(np.isfinite(g)) for g in slopes(x, jnp.asarray(width)))


def test_the_unit_vector_is_zero_at_zero_and_shortened_by_its_boundary_layer():
    x = jnp.array([3.0, -4.0])
    np.testing.assert_allclose(unit_vector(x, jnp.asarray(0.0)), [0.6, -0.8], rtol=1e-15)
    np.testing.assert_allclose(unit_vector(x, jnp.asarray(5.0)), [0.3, -0.4], rtol=1e-15)
    np.testing.assert_array_equal(unit_vector(jnp.zeros(2), jnp.asarray(0.0)), 0.0)


bases = st.floats(1e-6, 50.0)
reals = st.floats(-50.0, 50.0).filter(lambda x: x == 0 or abs(x) > 1e-6)
steep = st.floats(1.01, 4.0)

raised = jax.jit(power)
raised_slopes = jax.jit(jax.grad(power, argnums=(0, 1)))
raised_curvature = jax.jit(jax.grad(jax.grad(power)))
signed = jax.jit(sig)
signed_slope = jax.jit(lambda x, a: sig_and_slope(x, a)[1])
derivative_of_sig = jax.jit(jax.grad(sig))
derivative_of_even_power = jax.jit(jax.grad(lambda x, alpha: power(jnp.abs(x), alpha + 1.0)))


@given(bases, st.floats(-1.5, 4.0))
def test_the_power_agrees_with_numpy_for_positive_bases(x, a):
    assert float(raised(x, a)) == pytest.approx(np.power(x, a), rel=1e-13)


@given(bases, st.floats(-1.5, 4.0), st.floats(2.01, 4.0))
def test_derivatives_of_the_power_by_base_and_exponent_agree_with_closed_forms(x, a, b):
    by_x, by_a = raised_slopes(x, a)
    assert float(by_x) == pytest.approx(a * x ** (a - 1), rel=1e-12, abs=1e-300)
    assert float(by_a) == pytest.approx(x**a * np.log(x), rel=1e-12, abs=1e-13)
    assert float(raised_curvature(x, b)) == pytest.approx(b * (b - 1) * x ** (b - 2), rel=1e-11)


@pytest.mark.parametrize("a", [1.2, 2.0, 2.01, 3.5])
def test_the_power_and_its_derivatives_are_zero_at_a_base_of_zero(a):
    zero, exponent = jnp.asarray(0.0), jnp.asarray(a)
    assert float(power(zero, exponent)) == 0.0
    by_x, by_a = jax.grad(power, argnums=(0, 1))(zero, exponent)
    assert float(by_x) == float(by_a) == 0.0
    assert float(jax.grad(jax.grad(power))(zero, exponent)) == 0.0


def test_a_power_and_its_two_time_derivatives_compile_to_a_single_power_operation():
    def motion(t):
        return power(1.0 - t, jnp.asarray(2.01))

    def all_three(t):
        rate = jax.grad(motion)
        return motion(t), rate(t), jax.grad(rate)(t)

    hlo = jax.jit(all_three).lower(jnp.asarray(0.3)).compile().as_text()
    assert hlo.count(" power(") == 1


@given(st.lists(reals, min_size=1, max_size=5), st.floats(0.05, 4.0))
def test_sig_is_the_signed_power_of_each_entry(entries, a):
    x = np.array(entries)
    expected = np.abs(x) ** a * np.sign(x)
    np.testing.assert_allclose(sig(jnp.asarray(x), jnp.asarray(a)), expected, rtol=1e-12)


@given(reals, steep)
def test_the_slope_of_sig_agrees_with_equation_35_and_lemma_2(x, a):
    printed = a * abs(x) ** (a - 1)
    assert float(signed_slope(x, a)) == pytest.approx(printed, rel=1e-12)
    assert float(derivative_of_sig(x, a)) == pytest.approx(printed, rel=1e-12)
    assert float(signed(x, a)) == pytest.approx(float(sig_and_slope(jnp.asarray(x), jnp.asarray(a))[0]), rel=1e-15)


@given(reals, steep)
def test_the_slope_of_the_even_power_agrees_with_lemma_2(x, alpha):
    expected = (alpha + 1.0) * float(signed(x, alpha))
    assert float(derivative_of_even_power(x, alpha)) == pytest.approx(expected, rel=1e-12)


def test_sig_is_odd_and_increasing():
    x = jnp.linspace(-3.0, 3.0, 601)
    for a in (0.5, 1.2, 2.0):
        y = np.asarray(sig(x, jnp.asarray(a)))
        np.testing.assert_array_equal(y, -sig(-x, jnp.asarray(a)))
        assert np.all(np.diff(y) > 0)
    assert float(sig(jnp.asarray(0.0), jnp.asarray(0.5))) == 0.0


EACH_CORE = pytest.mark.parametrize(("p", "delta"), [(p, delta) for p in (0.1, 0.5, 0.9) for delta in (0.01, 0.3, 1.0)])
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


@given(errors, st.floats(-1.5, 1.5), exponents, widths)
def test_smooth_power_agrees_with_the_printed_formula(x, z, p, delta):
    for at in (x, z * delta):
        assert value(at, p, delta) == pytest.approx(printed(at, p, delta), rel=1e-12, abs=1e-300)


@given(st.floats(-3.0, 3.0), exponents, widths)
def test_smooth_power_slope_agrees_with_the_printed_slope_and_the_derivative(z, p, delta):
    x = z * delta
    assert slope(x, p, delta) == pytest.approx(printed_slope(x, p, delta), rel=1e-11)
    assert float(gradients(x, p, delta)[0]) == pytest.approx(slope(x, p, delta), rel=1e-11)


@EACH_CORE
def test_smooth_power_has_continuous_value_and_slope_at_the_edge_of_its_core(p, delta):
    l1, l2, l3 = coefficients(p, delta)
    inside = l1 * delta + l2 * delta**2 + l3 * delta**3
    inside_slope = l1 + 2 * l2 * delta + 3 * l3 * delta**2
    assert value(delta, p, delta) == pytest.approx(inside, rel=1e-12)
    assert slope(delta, p, delta) == pytest.approx(inside_slope, rel=1e-12)
    just_inside = delta * (1 - 1e-9)
    assert value(just_inside, p, delta) == pytest.approx(delta**p, rel=1e-8)
    assert slope(just_inside, p, delta) == pytest.approx(p * delta ** (p - 1), rel=1e-8)


@EACH_CORE
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_smooth_power_has_a_continuous_second_derivative_at_the_edge_of_its_core(p, delta, side):
    second = jax.grad(lambda x: smooth_power_slope(x, jnp.asarray(p), jnp.asarray(delta)))
    expected = side * p * (p - 1) * delta ** (p - 2)
    for near in (1 - 1e-9, 1 + 1e-9):
        assert float(second(jnp.asarray(side * delta * near))) == pytest.approx(expected, rel=1e-7)


@EACH_CORE
def test_smooth_power_is_odd_and_increasing_and_leaves_0_and_1_unchanged(p, delta):
    x = jnp.linspace(-3 * delta, 3 * delta, 601)
    y = np.asarray(smooth_power(x, jnp.asarray(p), jnp.asarray(delta)))
    assert np.array_equal(y, -smooth_power(-x, jnp.asarray(p), jnp.asarray(delta)))
    assert np.all(np.diff(y) > 0)
    assert np.all(np.asarray(smooth_power_slope(x, jnp.asarray(p), jnp.asarray(delta))) > 0)
    assert [value(x, p, delta) for x in (0.0, 1.0, -1.0)] == [0.0, 1.0, -1.0]


@given(st.floats(-3.0, 3.0), exponents, widths)
def test_smooth_power_gradients_by_exponent_and_core_width_match_finite_differences(z, p, delta):
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
