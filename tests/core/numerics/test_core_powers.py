"""The rivals' powers, (78) and that of [24], as printed; and the sign with a straight piece."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slidax.core import linear_core_power_and_slope, saturation, two_term_power_and_slope, unit_vector

exponents = st.floats(0.05, 0.95)
widths = st.floats(1e-3, 1.0)
cores = st.floats(1.05, 3.0)
# In widths of the core, and off its edge, where one of the two has a kink.
places = st.floats(-3.0, 3.0).filter(lambda z: abs(abs(z) - 1) > 1e-6 and (z == 0 or abs(z) > 1e-6))

linear_core = jax.jit(linear_core_power_and_slope)
two_term = jax.jit(two_term_power_and_slope)


@given(places, exponents, widths)
def test_the_linear_core_power_is_the_printed_one(z, p, delta):
    x = z * delta
    outside = abs(x) >= delta
    value, slope = linear_core(x, p, delta)
    assert float(value) == pytest.approx(abs(x) ** p * np.sign(x) if outside else delta ** (p - 1) * x, rel=1e-12)
    assert float(slope) == pytest.approx(p * abs(x) ** (p - 1) if outside else delta ** (p - 1), rel=1e-12)


def test_at_the_edge_the_linear_core_power_is_continuous_and_its_slope_jumps_to_the_outer_one():
    inside, inner = linear_core(0.01 * (1 - 1e-12), 0.5, 0.01)
    edge, outer = linear_core(0.01, 0.5, 0.01)
    assert float(inside) == pytest.approx(0.1, rel=1e-11)
    assert float(edge) == pytest.approx(0.1, rel=1e-12)
    assert float(inner) == pytest.approx(10.0, rel=1e-12)
    assert float(outer) == pytest.approx(5.0, rel=1e-12)


@given(places, exponents, cores, widths)
def test_the_two_term_power_is_that_of_the_equations(z, a, r, delta):
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


@pytest.mark.parametrize("x", [0.0, 1e-320, 1e-8, 0.01, -0.01, 0.3, 1e6])
@pytest.mark.parametrize("part", [0, 1])
def test_values_and_slopes_have_finite_gradients_everywhere(x, part):
    p, r, delta = (jnp.asarray(v) for v in (0.5, 1.7, 0.01))
    for function, arguments in ((linear_core, (p, delta)), (two_term, (p, r, delta))):
        by = jax.grad(lambda *a: function(*a)[part], argnums=tuple(range(len(arguments) + 1)))  # noqa: B023
        assert np.all(np.isfinite(by(jnp.asarray(x), *arguments)))


def test_saturation_is_the_sign_with_a_straight_piece():
    x = jnp.array([-2.0, -0.05, -0.02, 0.0, 0.02, 0.05, 2.0])
    np.testing.assert_allclose(saturation(x, jnp.asarray(0.05)), [-1, -1, -0.4, 0, 0.4, 1, 1], rtol=1e-14)
    np.testing.assert_array_equal(saturation(x, jnp.asarray(0.0)), np.sign(x))
    slopes = jax.grad(lambda x, w: jnp.sum(saturation(x, w)), argnums=(0, 1))
    for width in (0.0, 0.05):
        assert all(np.all(np.isfinite(g)) for g in slopes(x, jnp.asarray(width)))


def test_the_unit_vector_is_zero_at_zero_and_shorter_by_its_layer():
    x = jnp.array([3.0, -4.0])
    np.testing.assert_allclose(unit_vector(x, jnp.asarray(0.0)), [0.6, -0.8], rtol=1e-15)
    np.testing.assert_allclose(unit_vector(x, jnp.asarray(5.0)), [0.3, -0.4], rtol=1e-15)
    np.testing.assert_array_equal(unit_vector(jnp.zeros(2), jnp.asarray(0.0)), 0.0)
