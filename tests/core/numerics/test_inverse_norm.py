"""Spectral norm of an inverse compared with NumPy, for distant, near and equal eigenvalues."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core import inverse_norm

norm = jax.jit(inverse_norm)
gradient = jax.jit(jax.grad(inverse_norm))


def symmetric(values, seed):
    """A symmetric matrix with these eigenvalues and random eigenvectors."""
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(values), len(values))))
    a = (turn * values) @ turn.T
    return 0.5 * (a + a.T)


def of_numpy(a):
    return np.linalg.norm(np.linalg.inv(a), ord=2)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_closed_form_norm_of_the_inverse_agrees_with_numpy(n):
    rng = np.random.default_rng(0)
    for seed in range(100):
        a = symmetric(rng.uniform(0.1, 10.0, n), seed)
        np.testing.assert_allclose(norm(jnp.asarray(a)), of_numpy(a), rtol=1e-9)


@pytest.mark.parametrize(
    "values", [[2.0, 2.0], [1.0, 1e4], [1.0, 1.0, 5.0], [1.0, 5.0, 5.0], [3.0, 3.0, 3.0], [1.0, 1.0 + 1e-9, 1e3]]
)
def test_the_inverse_norm_is_accurate_and_has_finite_gradients_at_equal_and_distant_eigenvalues(values):
    accuracy = (3e-8 if len(values) == 3 else 1e-14) * max(values) / min(values)
    for a in (np.diag(values), symmetric(np.array(values), 1)):
        np.testing.assert_allclose(norm(jnp.asarray(a)), of_numpy(a), rtol=accuracy)
        assert np.all(np.isfinite(gradient(jnp.asarray(a))))


@pytest.mark.parametrize("n", [4, *(pytest.param(n, marks=pytest.mark.full) for n in (6, 7))])
def test_the_inverse_norm_of_larger_matrices_is_an_upper_bound_within_its_stated_factor(n):
    rng = np.random.default_rng(1)
    for seed in range(30):
        values = rng.uniform(0.1, 10.0, n) if seed else np.ones(n)
        a = symmetric(values, seed)
        ratio = float(norm(jnp.asarray(a))) / of_numpy(a)
        assert 1 - 1e-9 <= ratio <= n ** (1 / 1024) + 1e-9
        gap = np.sort(values)[1] / values.min()
        if gap > 1.03:
            assert ratio == pytest.approx(1.0, abs=1e-9)
        assert np.all(np.isfinite(gradient(jnp.asarray(a))))


@pytest.mark.parametrize("n", [2, 3, 5])
def test_the_gradient_of_the_inverse_norm_matches_finite_differences(n):
    a = symmetric(np.arange(1.0, n + 1.0), 3)
    along = symmetric(np.linspace(-1.0, 1.0, n), 4)
    h = 1e-6
    difference = (of_numpy(a + h * along) - of_numpy(a - h * along)) / (2 * h)
    derivative = np.sum(np.asarray(jax.jvp(norm, (jnp.asarray(a),), (jnp.asarray(along),))[1]))
    assert float(derivative) == pytest.approx(difference, rel=1e-6)


def test_the_inverse_norm_compiles_without_library_calls():
    for n in (2, 3, 7):
        program = jax.jit(inverse_norm).lower(jnp.eye(n)).compile().as_text()
        assert "custom-call" not in program
