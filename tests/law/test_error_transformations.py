"""The logarithmic transformation against (12), (13), (21), (23), (26), (27), and Proposition 4."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slidax.law import PrescribedPerformance, Sides, Unconstrained
from slidax.law.error_transformations import psi, psi_inverse, psi_inverse_slope
from tests.paper_examples import ENVELOPE_4_1

overshoots = st.floats(0.01, 0.99)
signs = st.sampled_from([-1, 1])
lines = st.floats(-30.0, 30.0)

forward = jax.jit(psi)
backward = jax.jit(psi_inverse)
backward_slope = jax.jit(psi_inverse_slope)
backward_derivative = jax.jit(jax.grad(lambda x, sides: jnp.sum(psi_inverse(x, sides))))
forward_derivative = jax.jit(jax.grad(lambda x, sides: jnp.sum(psi(x, sides))))


def sides(overshoot: float, sign: int) -> tuple[float, float]:
    """(13): b and b̄ by the sign of e(0)."""
    return (-overshoot, 1.0) if sign >= 0 else (-1.0, overshoot)


def as_sides(overshoot: float, sign: int) -> Sides:
    b, b_bar = sides(overshoot, sign)
    return Sides(lower=jnp.array([b]), upper=jnp.array([b_bar]))


@given(lines, overshoots, signs)
def test_psi_agrees_with_the_printed_formula(x, overshoot, sign):
    b, b_bar = sides(overshoot, sign)
    printed = b * b_bar * (np.exp(x) - 1) / (b * np.exp(x) - b_bar)
    assert float(forward(jnp.array([x]), as_sides(overshoot, sign))[0]) == pytest.approx(printed, rel=1e-9, abs=1e-15)


@given(st.floats(0.001, 0.999), overshoots, signs)
def test_psi_inverse_and_its_slope_agree_with_the_printed_formulas(share, overshoot, sign):
    b, b_bar = sides(overshoot, sign)
    x = b + share * (b_bar - b)
    inverse = np.log(b_bar * (x - b) / (-b * (b_bar - x)))
    v = 1 / (x - b) + 1 / (b_bar - x)
    given_inverse = backward(jnp.array([x]), as_sides(overshoot, sign))[0]
    assert float(given_inverse) == pytest.approx(inverse, rel=1e-12, abs=1e-14)
    assert float(backward_slope(jnp.array([x]), as_sides(overshoot, sign))[0]) == pytest.approx(v, rel=1e-12)
    assert float(backward_derivative(jnp.array([x]), as_sides(overshoot, sign))[0]) == pytest.approx(v, rel=1e-10)


@given(st.floats(-12.0, 12.0), overshoots, signs)
def test_psi_inverse_of_psi_is_the_identity(x, overshoot, sign):
    s = as_sides(overshoot, sign)
    assert float(backward(forward(jnp.array([x]), s), s)[0]) == pytest.approx(x, rel=1e-9, abs=1e-9)


@given(st.floats(1e-9, 1 - 1e-9), overshoots, signs)
def test_psi_of_psi_inverse_is_the_identity(share, overshoot, sign):
    b, b_bar = sides(overshoot, sign)
    x = b + share * (b_bar - b)
    assume(b < x < b_bar)
    s = as_sides(overshoot, sign)
    assert float(forward(backward(jnp.array([x]), s), s)[0]) == pytest.approx(x, rel=1e-12, abs=1e-14)


@given(lines, lines, overshoots, signs)
def test_psi_increases_strictly(x, y, overshoot, sign):
    assume(abs(x - y) > 1e-3)
    s = as_sides(overshoot, sign)
    low, high = (float(forward(jnp.array([z]), s)[0]) for z in sorted((x, y)))
    assert low < high


@given(st.one_of(lines, st.floats(-1e300, 1e300)), overshoots, signs)
def test_psi_of_any_transformed_error_is_within_its_bounds(x, overshoot, sign):
    """Proposition 4: (22) guarantees (12), up to rounding at the bounds themselves."""
    b, b_bar = sides(overshoot, sign)
    assert b <= float(forward(jnp.array([x]), as_sides(overshoot, sign))[0]) <= b_bar
    if abs(x) < 30:
        assert b < float(forward(jnp.array([x]), as_sides(overshoot, sign))[0]) < b_bar


@pytest.mark.parametrize("sign", [-1, 1])
def test_psi_tends_to_its_bounds(sign):
    s = as_sides(0.2, sign)
    b, b_bar = sides(0.2, sign)
    for x in (50.0, 800.0, 1e300):
        assert float(forward(jnp.array([x]), s)[0]) == pytest.approx(b_bar, rel=1e-14)
        assert float(forward(jnp.array([-x]), s)[0]) == pytest.approx(b, rel=1e-14)


@pytest.mark.parametrize("x", [-1e300, -800.0, -1.0, 0.0, 1.0, 800.0, 1e300])
def test_psi_has_a_finite_slope_everywhere(x):
    slope = float(forward_derivative(jnp.array([x]), as_sides(0.2, 1))[0])
    assert np.isfinite(slope) and slope >= 0


def test_psi_inverse_is_nan_outside_its_bounds():
    for x in (-0.21, 1.01):
        assert np.isnan(backward(jnp.array([x]), as_sides(0.2, 1))[0])


@pytest.mark.parametrize(
    ("e", "lower", "upper"), [(0.3, -0.2, 1.0), (-0.3, -1.0, 0.2), (0.0, -0.2, 1.0)], ids=["above", "below", "zero"]
)
def test_the_envelope_is_wide_on_the_side_of_the_initial_error(e, lower, upper):
    memory = PrescribedPerformance(ENVELOPE_4_1, 0.2).init(jnp.asarray(0.0), jnp.array([e, e]))
    np.testing.assert_array_equal(memory.lower, [lower, lower])
    np.testing.assert_array_equal(memory.upper, [upper, upper])


def test_the_envelope_is_the_sides_times_the_radius():
    transformation = PrescribedPerformance(ENVELOPE_4_1, [0.2, 0.4])
    memory = transformation.init(jnp.asarray(0.0), jnp.array([-0.6, 0.5]))
    for t in (0.0, 1.0, 7.0):
        rho = np.asarray(ENVELOPE_4_1.radius(jnp.asarray(t)))
        envelope = transformation.envelope(jnp.asarray(t), memory)
        np.testing.assert_allclose(envelope.lower, np.array([-1.0, -0.4]) * rho, rtol=1e-15)
        np.testing.assert_allclose(envelope.upper, np.array([0.2, 1.0]) * rho, rtol=1e-15)


@given(st.floats(0.0, 6.5), st.floats(0.01, 0.99), st.floats(-2.0, 2.0))
def test_alpha_beta_and_the_transformed_errors_agree_with_the_printed_formulas(t, share, de):
    """(24)-(28), and Ȧ, written out for the paper's first joint, which starts below."""
    z = max(0.0, 1 - t / 5.0)
    rho = 0.798 * z**2.01 + 0.002
    rate = -2.01 / 5.0 * 0.798 * z**1.01
    curvature = 2.01 * 1.01 / 25.0 * 0.798 * z**0.01 if z > 0 else 0.0
    e = rho * (-1.0 + share * 1.2)
    error = transform(t, jnp.array([e, 0.0]), jnp.array([de, 0.0]))
    x = e / rho
    alpha = -rate / rho
    beta = (1 / (x + 1.0) + 1 / (0.2 - x)) / rho
    assert float(error.alpha[0]) == pytest.approx(alpha, rel=1e-9)
    assert float(error.alpha_rate[0]) == pytest.approx(-(curvature * rho - rate**2) / rho**2, rel=1e-8, abs=1e-12)
    assert float(error.beta[0]) == pytest.approx(beta, rel=1e-9)
    assert float(error.eps2[0]) == pytest.approx(beta * (de + alpha * e), rel=1e-8, abs=1e-9 * beta)
    assert float(error.eps1[0]) == pytest.approx(np.log(0.2 * (x + 1.0) / (0.2 - x)), rel=1e-8, abs=1e-9)


@jax.jit
def transform(t, e, de):
    transformation = PrescribedPerformance(ENVELOPE_4_1, 0.2)
    memory = transformation.init(jnp.asarray(0.0), jnp.array([-0.6, 0.5]))
    return transformation(t, e, de, memory)


def test_unconstrained_transformation_leaves_errors_unchanged_and_has_no_envelope():
    transformation = Unconstrained()
    e, de = jnp.array([0.3, -0.2]), jnp.array([1.0, 0.0])
    memory = transformation.init(jnp.zeros(()), e)
    error = transformation(jnp.ones(()), e, de, memory)
    np.testing.assert_array_equal(error.eps1, e)
    np.testing.assert_array_equal(error.eps2, de)
    np.testing.assert_array_equal(error.beta, 1.0)
    np.testing.assert_array_equal(error.alpha, 0.0)
    np.testing.assert_array_equal(error.alpha_rate, 0.0)
    assert memory == () and transformation.envelope(jnp.ones(()), memory) is None
