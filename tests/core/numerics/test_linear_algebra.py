"""The unrolled solve and products compared with NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slidax.core import is_positive_definite, matvec, solve_symmetric, vector_norm

SIZES = range(1, 8)
solve = jax.jit(solve_symmetric)
entries = st.floats(-3.0, 3.0)


def positive_definite(factor: np.ndarray) -> np.ndarray:
    return factor @ factor.T + 0.1 * np.eye(len(factor))


@pytest.mark.parametrize("n", SIZES)
def test_the_symmetric_solve_agrees_with_numpy(n):
    @settings(max_examples=30)
    @given(arrays(float, (n, n), elements=entries), arrays(float, n, elements=entries))
    def agrees(factor, b):
        a = positive_definite(factor)
        exact = np.linalg.solve(a, b)
        tolerance = 1e-14 * np.linalg.cond(a) * max(1.0, np.abs(exact).max())
        np.testing.assert_allclose(solve(jnp.asarray(a), jnp.asarray(b)), exact, rtol=0, atol=tolerance)

    agrees()


def test_the_symmetric_solve_reads_the_lower_triangle_only():
    a = positive_definite(np.random.default_rng(1).normal(size=(4, 4)))
    b = np.arange(4.0)
    spoilt = jnp.asarray(np.tril(a) + np.triu(np.full((4, 4), np.nan), 1))
    np.testing.assert_allclose(solve(spoilt, jnp.asarray(b)), np.linalg.solve(a, b), rtol=1e-9)


@pytest.mark.full
def test_the_gradient_of_the_symmetric_solve_is_the_inverse_matrix():
    a = positive_definite(np.random.default_rng(2).normal(size=(3, 3)))
    by_b = jax.jacfwd(lambda b: solve_symmetric(jnp.asarray(a), b))(jnp.ones(3))
    np.testing.assert_allclose(by_b, np.linalg.inv(a), rtol=1e-10)


@pytest.mark.parametrize("n", SIZES)
def test_the_matrix_vector_product_agrees_with_numpy(n):
    rng = np.random.default_rng(n)
    a, x = rng.normal(size=(n, n)), rng.normal(size=n)
    np.testing.assert_allclose(matvec(jnp.asarray(a), jnp.asarray(x)), a @ x, rtol=1e-12, atol=1e-14)


@given(arrays(float, st.integers(1, 7), elements=st.floats(-1e3, 1e3).filter(lambda x: x == 0 or abs(x) > 1e-100)))
def test_the_vector_norm_agrees_with_numpy(x):
    assert float(vector_norm(jnp.asarray(x))) == pytest.approx(np.linalg.norm(x), rel=1e-14)


def test_the_vector_norm_has_a_unit_gradient_and_a_zero_gradient_at_zero():
    x = jnp.array([3.0, -4.0])
    np.testing.assert_allclose(jax.grad(vector_norm)(x), [0.6, -0.8], rtol=1e-15)
    np.testing.assert_array_equal(jax.grad(vector_norm)(jnp.zeros(2)), [0.0, 0.0])
    assert float(vector_norm(jnp.zeros(2))) == 0.0


def test_semidefinite_indefinite_and_asymmetric_matrices_are_not_positive_definite():
    assert is_positive_definite(np.array([[2.0, 1.0], [1.0, 2.0]]))
    assert not is_positive_definite(np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert not is_positive_definite(np.array([[0.0, 0.0], [0.0, 1.0]]))
    assert not is_positive_definite(np.array([[2.0, 1.0], [0.5, 2.0]]))
