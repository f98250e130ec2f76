"""Definition 4 over every performance function: positive, decreasing, smooth, with a positive limit."""

import jax
import jax.numpy as jnp
import numpy as np

from tests.enrolled import assert_finite, every
from tests.law.members import PERFORMANCES, PERFORMANCES_LIKE_OTHERS

TIMES = np.linspace(0.0, 30.0, 3001)
EVERY = every("performance", PERFORMANCES, full=PERFORMANCES_LIKE_OTHERS)


def curve(performance, t=TIMES):
    return tuple(np.asarray(y) for y in jax.jit(jax.vmap(performance.radius_rate_curvature))(jnp.asarray(t)))


@EVERY
def test_the_radius_is_positive_and_between_its_final_and_initial_values(performance):
    rho, _, _ = curve(performance)
    assert np.all(rho >= np.asarray(performance.final))
    assert np.all(rho <= np.asarray(performance.initial) * (1 + 1e-15))
    assert np.all(np.asarray(performance.final) > 0)


@EVERY
def test_the_radius_never_grows(performance):
    rho, rate, _ = curve(performance)
    assert np.all(np.diff(rho, axis=0) <= 0) and np.all(rate <= 0)


@EVERY
def test_the_radius_goes_from_its_initial_to_its_final_value(performance):
    np.testing.assert_allclose(performance.radius(jnp.asarray(0.0)), performance.initial * jnp.ones(()), rtol=1e-14)
    end = np.asarray(performance.radius(jnp.asarray(1e4)))
    np.testing.assert_allclose(end, np.broadcast_to(performance.final, end.shape), rtol=1e-14)


@EVERY
def test_rate_and_curvature_match_differences_of_the_radius(performance):
    t = np.random.default_rng(0).uniform(0.01, 10.0, 100)
    h = 1e-6
    _, rate, curvature = curve(performance, t)
    before, after = curve(performance, t - h), curve(performance, t + h)
    scale = np.maximum(1.0, np.asarray(performance.initial))
    np.testing.assert_allclose(rate / scale, (after[0] - before[0]) / (2 * h) / scale, atol=1e-8)
    np.testing.assert_allclose(curvature / scale, (after[1] - before[1]) / (2 * h) / scale, atol=1e-6)


@EVERY
def test_all_gains_are_leaves_with_finite_gradients_at_any_time(performance):
    def all_three(performance, t):
        return sum(jnp.sum(y) for y in performance.radius_rate_curvature(t))

    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in jax.tree.leaves(performance))
    gradients = jax.jit(jax.grad(all_three))
    for t in (0.0, 2.0, 4.999999, 5.0, 6.0, 100.0):
        gradient = gradients(performance, jnp.asarray(t))
        assert_finite(gradient)
