"""Roots of increasing functions, one for each joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .powers import tangent_mask
from .types import Vector

NEWTON = 16
"""Number of first iterations, which try a Newton step. Two or three usually suffice. The equation of
`law.implicit_steps.Barrier` has needed at most 14."""

HALVINGS = 52
"""Number of next iterations. Each halves the bracket, until its ends differ by rounding only."""

ITERATIONS = NEWTON + HALVINGS + 4
"""Largest number of iterations. The last four try a Newton step again, now from a point close to the root."""

Increasing = Callable[[Any, Vector], tuple[Vector, Vector]]
"""From parameters and a point [n] to values [n] and slopes [n]; each entry is a separate function of one variable."""


class _RootSearch(eqx.Module):
    x: Vector
    value: Vector
    slope: Vector
    lower: Vector
    upper: Vector
    halved: Bool[Array, " n"]
    step: Int[Array, ""]


def increasing_root(
    function: Increasing,
    parameters: Any,
    target: Vector,
    guess: Vector,
    at_guess: tuple[Vector, Vector],
    bracket: tuple[Vector, Vector],
    tolerance: Vector,
) -> Vector:
    """The x with `f(x) = target`, [n], by Newton steps that fall back on bisection.

    It takes at most `ITERATIONS` iterations for any f, target and guess. Then either `|f(x) - target| <= tolerance`, or
    x is within `(upper - lower) 2⁻⁵²` of the root: the bracket always contains the root, and 52 iterations halve it.

    JAX's derivative of x is that of the exact root, `dx = (d target - ∂f/∂parameters d parameters)/f'`, whatever the
    iterations were.

    - `function`: from `parameters` and x to f(x) and its slope, [n] each; entry k is an increasing function of x_k.
    - `parameters`: further arguments of f; any pytree.
    - `target`: wanted value of f, [n].
    - `guess`: first point, inside the bracket, [n].
    - `at_guess`: value and slope of f at the guess, [n] each.
    - `bracket`: (lower, upper), with the root between them, [n] each.
    - `tolerance`: largest allowed distance of f(x) from the target, [n].
    """
    return _root(function, parameters, target, (guess, at_guess, bracket, tolerance))


@eqx.filter_custom_jvp
def _root(function: Increasing, parameters: Any, target: Vector, search: Any) -> Vector:
    guess, at_guess, bracket, tolerance = search

    def unfinished(now: _RootSearch) -> Bool[Array, ""]:
        # A bracket without a floating-point number inside cannot be narrowed.
        middle = 0.5 * (now.lower + now.upper)
        divisible = (middle > now.lower) & (middle < now.upper)
        return jnp.any((jnp.abs(now.value - target) > tolerance) & divisible) & (now.step < ITERATIONS)

    def step(now: _RootSearch) -> _RootSearch:
        residual = now.value - target
        newton = now.x - residual / now.slope
        tried = (now.step < NEWTON) | (now.step >= NEWTON + HALVINGS)
        trusted = tried & now.halved & (newton > now.lower) & (newton < now.upper)
        x = jnp.where(trusted, newton, 0.5 * (now.lower + now.upper))
        x = jnp.where(jnp.abs(residual) <= tolerance, now.x, x)
        value, slope = function(parameters, x)
        return _narrowed(now, x, value, slope, target)

    lower, upper = bracket
    value, slope = at_guess
    first = _RootSearch(guess, value, slope, lower, upper, jnp.ones(guess.shape, bool), jnp.zeros((), int))
    first = _narrowed(eqx.tree_at(lambda s: s.value, first, target + jnp.inf), guess, value, slope, target)
    return jax.lax.while_loop(unfinished, step, first).x


def _narrowed(now: _RootSearch, x: Vector, value: Vector, slope: Vector, target: Vector) -> _RootSearch:
    """Return the search after an evaluation at x, with the bracket narrowed."""
    residual = value - target
    return _RootSearch(
        x=x,
        value=value,
        slope=slope,
        lower=jnp.where(residual < 0, x, now.lower),
        upper=jnp.where(residual > 0, x, now.upper),
        halved=jnp.abs(residual) <= 0.5 * jnp.abs(now.value - target),
        step=now.step + 1,
    )


@_root.def_jvp  # type: ignore[untyped-decorator]
def _root_jvp(primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    function, parameters, target, search = primals
    _, d_parameters, d_target, _ = tangents
    x = _root(function, parameters, target, search)
    slope = function(parameters, x)[1]
    moving, rest = eqx.partition(parameters, tangent_mask(parameters, d_parameters))
    d_moving = eqx.filter(d_parameters, tangent_mask(parameters, d_parameters))
    d_value = jnp.zeros_like(x)
    if jax.tree.leaves(moving):
        _, d_value = jax.jvp(lambda p: function(eqx.combine(p, rest), x)[0], (moving,), (d_moving,))
    wanted = jnp.zeros_like(x) if d_target is None else d_target
    return x, (wanted - d_value) / slope
