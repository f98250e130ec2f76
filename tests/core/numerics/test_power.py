"""Powers: (1), (2), (34), (35), Lemma 2, and derivatives that never turn infinite."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slidax.core import power, sig, sig_and_slope

bases = st.floats(0.0, 50.0).filter(lambda x: x == 0 or x > 1e-6)
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
def test_the_power_is_that_of_numpy(x, a):
    if x > 0:
        assert float(raised(x, a)) == pytest.approx(np.power(x, a), rel=1e-13)


@given(bases.filter(lambda x: x > 0), st.floats(-1.5, 4.0))
def test_the_powers_derivatives_are_the_true_ones(x, a):
    by_x, by_a = raised_slopes(x, a)
    assert float(by_x) == pytest.approx(a * x ** (a - 1), rel=1e-12, abs=1e-300)
    assert float(by_a) == pytest.approx(x**a * np.log(x), rel=1e-12, abs=1e-13)


@given(bases.filter(lambda x: x > 0), st.floats(2.01, 4.0))
def test_the_powers_second_derivative_is_the_true_one(x, a):
    second = raised_curvature(x, a)
    assert float(second) == pytest.approx(a * (a - 1) * x ** (a - 2), rel=1e-11)


@pytest.mark.parametrize("a", [1.2, 2.0, 2.01, 3.5])
def test_at_zero_the_power_and_its_derivatives_are_zero(a):
    zero, exponent = jnp.asarray(0.0), jnp.asarray(a)
    assert float(power(zero, exponent)) == 0.0
    by_x, by_a = jax.grad(power, argnums=(0, 1))(zero, exponent)
    assert float(by_x) == 0.0
    assert float(by_a) == 0.0
    assert float(jax.grad(jax.grad(power))(zero, exponent)) == 0.0


def test_a_power_and_its_two_time_derivatives_share_a_single_pow():
    def motion(t):
        return power(1.0 - t, jnp.asarray(2.01))

    def all_three(t):
        rate = jax.grad(motion)
        return motion(t), rate(t), jax.grad(rate)(t)

    hlo = jax.jit(all_three).lower(jnp.asarray(0.3)).compile().as_text()
    assert hlo.count(" power(") == 1


@given(reals, st.floats(0.05, 4.0))
def test_sig_is_the_signed_power(x, a):
    expected = abs(x) ** a * np.sign(x)
    assert float(signed(x, a)) == pytest.approx(expected, rel=1e-12)


@given(st.lists(reals, min_size=1, max_size=5), steep)
def test_sig_acts_on_each_entry_of_a_vector(entries, a):
    x = np.array(entries)
    expected = np.abs(x) ** a * np.sign(x)
    np.testing.assert_allclose(sig(jnp.asarray(x), jnp.asarray(a)), expected, rtol=1e-12)


@given(reals, steep)
def test_the_slope_of_sig_is_the_one_of_eq_35_and_of_lemma_2(x, a):
    printed = a * abs(x) ** (a - 1)
    assert float(signed_slope(x, a)) == pytest.approx(printed, rel=1e-12)
    assert float(derivative_of_sig(x, a)) == pytest.approx(printed, rel=1e-12)


@given(reals, steep)
def test_the_even_power_of_lemma_2_has_the_odd_one_as_its_slope(x, alpha):
    expected = (alpha + 1.0) * float(signed(x, alpha))
    assert float(derivative_of_even_power(x, alpha)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("x", [0.0, -0.0, 1e-320, -1e-12, 1e12])
@pytest.mark.parametrize("part", [0, 1])
def test_sig_and_its_slope_have_finite_gradients_everywhere(x, part):
    def function(x, a):
        return sig_and_slope(x, a)[part]

    value = function(jnp.asarray(x), jnp.asarray(1.2))
    by_x, by_a = jax.grad(function, argnums=(0, 1))(jnp.asarray(x), jnp.asarray(1.2))
    assert np.isfinite(value)
    assert np.isfinite(by_x)
    assert np.isfinite(by_a)


@given(reals, steep)
def test_sig_alone_is_the_first_of_sig_and_slope(x, a):
    assert float(signed(x, a)) == pytest.approx(float(sig_and_slope(jnp.asarray(x), jnp.asarray(a))[0]), rel=1e-15)


def test_sig_is_odd_and_increasing():
    x = jnp.linspace(-3.0, 3.0, 601)
    for a in (0.5, 1.2, 2.0):
        y = np.asarray(sig(x, jnp.asarray(a)))
        np.testing.assert_array_equal(y, -sig(-x, jnp.asarray(a)))
        assert np.all(np.diff(y) > 0)
    assert float(sig(jnp.asarray(0.0), jnp.asarray(0.5))) == 0.0


@given(reals, reals, steep)
def test_the_forward_derivative_counts_both_arguments(dx, da, a):
    x = 2.0
    _, tangent = jax.jvp(power, (jnp.asarray(x), jnp.asarray(a)), (jnp.asarray(dx), jnp.asarray(da)))
    expected = a * x ** (a - 1) * dx + x**a * np.log(x) * da
    assert float(tangent) == pytest.approx(expected, rel=1e-12, abs=1e-10)
