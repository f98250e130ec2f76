"""Every surface is an odd, increasing, continuously differentiable function φ per joint."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax.law import LinearCoreFixedTime
from tests.enrolled import assert_finite, every
from tests.law.members import SURFACES, SURFACES_LIKE_OTHERS

# The slope of the surface with a linear core jumps, so tests of smoothness apply only to the others.
SMOOTH = [(name, member) for name, member in SURFACES if not isinstance(member, LinearCoreFixedTime)]
EVERY = every("surface", SURFACES, full=SURFACES_LIKE_OTHERS)
GRID = np.concatenate([np.linspace(-3.0, 3.0, 1201), np.linspace(-0.02, 0.02, 801)])
GRID.sort()


def phi(surface, eps):
    return surface.phi_and_slope(eps)[0]


def slope(surface, eps):
    return surface.phi_and_slope(eps)[1]


def over(function):
    eps = jnp.stack([jnp.asarray(GRID), jnp.asarray(GRID)], axis=1)
    return np.asarray(jax.jit(jax.vmap(function))(eps))


@EVERY
def test_phi_is_odd_and_vanishes_at_zero(surface):
    np.testing.assert_allclose(over(lambda eps: phi(surface, eps)), -over(lambda eps: phi(surface, -eps)), rtol=1e-15)
    np.testing.assert_array_equal(phi(surface, jnp.zeros(2)), 0.0)


@EVERY
def test_phi_increases_with_the_error(surface):
    assert np.all(np.diff(over(lambda eps: phi(surface, eps)), axis=0)[np.diff(GRID) > 0] > 0)
    assert np.all(over(lambda eps: slope(surface, eps)) > 0)


@EVERY
def test_the_slope_is_the_derivative_of_phi(surface):
    derivative = over(jax.grad(lambda eps: jnp.sum(phi(surface, eps))))
    np.testing.assert_allclose(over(lambda eps: slope(surface, eps)), derivative, rtol=1e-11)


@EVERY
def test_each_joints_phi_depends_on_its_own_error_alone(surface):
    jacobian = jax.jit(jax.jacfwd(lambda eps: phi(surface, eps)))(jnp.array([0.3, -0.004]))
    np.testing.assert_array_equal(jacobian - np.diag(np.diagonal(jacobian)), 0.0)


@every("surface", SMOOTH, full=SURFACES_LIKE_OTHERS)
def test_the_slope_is_continuous(surface):
    """Bisection towards the largest change would close in on a jump; without a jump the change vanishes."""
    at = jax.jit(lambda x: slope(surface, jnp.stack([x, x])))
    for low, high in ((-1.2, 0.0), (0.0, 0.7), (0.0, 0.1), (0.005, 1.3)):
        first = np.abs(at(high) - at(low)).max()
        for _ in range(100):
            middle = 0.5 * (low + high)
            lower, upper = np.abs(at(middle) - at(low)).max(), np.abs(at(high) - at(middle)).max()
            low, high = (low, middle) if lower > upper else (middle, high)
        assert np.abs(at(high) - at(low)).max() <= 1e-3 * first


@EVERY
def test_all_gains_have_finite_gradients_also_at_zero_error(surface):
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in jax.tree.leaves(surface))

    @jax.jit
    def gradients(surface, eps):
        return [jax.grad(lambda surface, part=part: jnp.sum(part(surface, eps)))(surface) for part in (phi, slope)]

    for eps in (jnp.zeros(2), jnp.array([0.01, -0.01]), jnp.array([20.0, -20.0])):
        for gradient in gradients(surface, eps):
            assert_finite(gradient)


@EVERY
def test_reach_returns_an_error_at_which_phi_is_at_least_as_large(surface):
    sizes = jnp.asarray(np.logspace(-6, 6, 97))
    eps = jax.jit(jax.vmap(lambda size: surface.reach(jnp.stack([size, size]))))(sizes)
    reached = jax.jit(jax.vmap(lambda eps: phi(surface, eps)))(eps)
    assert np.all(np.asarray(reached) >= np.asarray(sizes)[:, None] * (1 - 1e-12))
