"""Roots of increasing functions: found from anywhere, and differentiated as roots are."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax.numerics import increasing_root


def cubic(parameters, x):
    """`a x³ + b x`, flat where b is small: where a plain Newton step is thrown far out."""
    a, b = parameters
    return a * x**3 + b * x, 3.0 * a * x**2 + b


def stiff(parameters, x):
    """A steep step on a slope, as a narrow envelope is: Newton steps from outside it jump to and fro."""
    width, rate = parameters
    return jnp.tanh(x / width) + rate * x, (1.0 - jnp.tanh(x / width) ** 2) / width + rate


def solved(function, parameters, target, guess):
    bracket = (jnp.full_like(target, -1e6), jnp.full_like(target, 1e6))
    at_guess = function(parameters, guess)
    return increasing_root(function, parameters, target, guess, at_guess, bracket, 1e-12 * (1 + jnp.abs(target)))


def test_roots_are_found_from_any_guess():
    rng = np.random.default_rng(0)
    target, guess = (
        jnp.asarray(rng.normal(size=500) * 10),
        jnp.asarray(rng.normal(size=500) * 10 ** rng.uniform(-6, 5, 500)),
    )
    for function, parameters in ((cubic, (jnp.asarray(2.0), jnp.asarray(1e-3))), (stiff, (jnp.asarray(1e-3), 1e-2))):
        x = jax.jit(lambda t, g, f=function, p=parameters: solved(f, p, t, g))(target, guess)
        np.testing.assert_allclose(function(parameters, x)[0], target, rtol=2e-12, atol=2e-12)


def test_a_guess_that_is_the_root_stays_as_it_is():
    guess = jnp.array([1.5, -0.2])
    parameters = (jnp.asarray(2.0), jnp.asarray(1.0))
    target = cubic(parameters, guess)[0]
    np.testing.assert_array_equal(solved(cubic, parameters, target, guess), guess)


def test_the_derivative_is_that_of_the_root_forwards_and_backwards():
    target, guess = jnp.array([5.0, -1.0]), jnp.zeros(2)
    a, b = jnp.array([2.0, 3.0]), jnp.array([1.0, 0.5])

    def root(a, b, target):
        return solved(cubic, (a, b), target, guess)

    x = root(a, b, target)
    slope = cubic((a, b), x)[1]
    for jacobian in (jax.jacfwd, jax.jit(jax.jacrev(root, argnums=(0, 1, 2)))):
        found = jacobian(a, b, target) if jacobian is not jax.jacfwd else jax.jacfwd(root, (0, 1, 2))(a, b, target)
        for given, expected in zip(found, (-(x**3) / slope, -x / slope, 1 / slope), strict=True):
            np.testing.assert_allclose(given, np.diag(expected), rtol=1e-9)
