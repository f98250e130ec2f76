"""Roots of increasing functions: convergence from any guess, and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slidax.core import increasing_root
from slidax.core.root_finding import ITERATIONS


def cubic(parameters, x):
    """`a x³ + b x`; for small b it is flat near 0, and a plain Newton step goes far away."""
    a, b = parameters
    return a * x**3 + b * x, 3.0 * a * x**2 + b


def stiff(parameters, x):
    """A steep step on a slope, as in a narrow envelope: Newton steps from outside alternate between its sides."""
    width, rate = parameters
    return jnp.tanh(x / width) + rate * x, (1.0 - jnp.tanh(x / width) ** 2) / width + rate


def solved(function, parameters, target, guess):
    bracket = (jnp.full_like(target, -1e6), jnp.full_like(target, 1e6))
    at_guess = function(parameters, guess)
    return increasing_root(function, parameters, target, guess, at_guess, bracket, 1e-12 * (1 + jnp.abs(target)))


def test_the_root_solver_converges_from_any_guess():
    rng = np.random.default_rng(0)
    target = jnp.asarray(rng.normal(size=500) * 10)
    guess = jnp.asarray(rng.normal(size=500) * 10 ** rng.uniform(-6, 5, 500))
    for function, parameters in ((cubic, (jnp.asarray(2.0), jnp.asarray(1e-3))), (stiff, (jnp.asarray(1e-3), 1e-2))):
        x = jax.jit(lambda t, g, f=function, p=parameters: solved(f, p, t, g))(target, guess)
        np.testing.assert_allclose(function(parameters, x)[0], target, rtol=2e-12, atol=2e-12)


def test_a_guess_that_is_the_root_is_returned_unchanged():
    guess = jnp.array([1.5, -0.2])
    parameters = (jnp.asarray(2.0), jnp.asarray(1.0))
    target = cubic(parameters, guess)[0]
    np.testing.assert_array_equal(solved(cubic, parameters, target, guess), guess)


@settings(max_examples=6)
@given(st.lists(st.floats(-9, 2), min_size=1, max_size=5), st.floats(-1, 1), st.floats(-1, 1), st.floats(-8, -1))
def test_the_root_solver_reaches_its_tolerance_within_its_iteration_limit(steepness, where, guess, rate):
    """A staircase: a Newton step on one stair has no information about the next stair."""
    turns = 0

    def stairs(parameters, x):
        nonlocal turns
        turns += 1
        width = 10.0**parameters
        places = jnp.linspace(-0.9, 0.9, len(steepness))
        up = jnp.tanh((x[:, None] - places) / width)
        slope = jnp.sum((1.0 - up**2) / width, axis=1) + 10.0**rate
        return jnp.sum(up, axis=1) + 10.0**rate * x, slope

    wanted, parameters = jnp.array([where]), jnp.asarray(steepness)
    target, start = stairs(parameters, wanted)[0], jnp.array([guess])
    with jax.disable_jit():
        at_guess = stairs(parameters, start)
        turns = 1
        bracket = (jnp.array([-1.0]), jnp.array([1.0]))
        x = increasing_root(stairs, parameters, target, start, at_guess, bracket, jnp.array([1e-15]))
    assert turns <= ITERATIONS
    left = abs(float(stairs(parameters, x)[0][0] - target[0]))
    # On a steep step, rounding of x alone causes an error of this size.
    assert left <= 1e-15 or abs(float(x[0] - where)) <= 2 * 2.0**-52 + 1e-15 / 10.0**rate


def test_derivatives_of_the_root_agree_with_implicit_differentiation_in_both_modes():
    target, guess = jnp.array([5.0, -1.0]), jnp.zeros(2)
    a, b = jnp.array([2.0, 3.0]), jnp.array([1.0, 0.5])

    def root(a, b, target):
        return solved(cubic, (a, b), target, guess)

    x = root(a, b, target)
    slope = cubic((a, b), x)[1]
    for jacobian in (jax.jacfwd(root, (0, 1, 2)), jax.jit(jax.jacrev(root, (0, 1, 2)))):
        for by_each, expected in zip(jacobian(a, b, target), (-(x**3) / slope, -x / slope, 1 / slope), strict=True):
            np.testing.assert_allclose(by_each, np.diag(expected), rtol=1e-9)
