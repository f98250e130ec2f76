"""One implicit Euler step of a reaching law with a power and a unit vector."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax.numerics import matvec, solve_symmetric, tangent_mask, vector_norm
from slidax.parts import Matrix, Scalar, Vector

STEPS = 64
"""Newton steps and halvings at most; nearly always two to four are enough."""

PRECISION = 2e-13
"""The residual that is reached, relative to 1 and the push."""


TINY = 1e-150
"""Smallest divisor of a division by a length; its square does not underflow."""


@runtime_checkable
class Reaching(Protocol):
    """Reaching law with a power that acts on each joint alone, and a boundary layer."""

    layer: Scalar

    def continuous_term_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """The continuous term and its derivative, [n].

        - `s`: sliding variable [n].
        """

    def moved(self, s: Vector, step: Vector) -> Vector:
        """Point after a Newton step, in coordinates in which the continuous term is nearly linear, [n].

        - `s`: sliding variable [n].
        - `step`: of it [n].
        """


class _Search(eqx.Module):
    s: Vector
    size: Scalar
    direction: Vector
    fraction: Scalar
    careful: Bool[Array, ""]
    step: Int[Array, ""]


def proximal_step(reaching: Reaching, metric: Matrix, s: Vector, u: Scalar) -> Vector:
    """The s⁺ with `A (s⁺ - s) = -P(s⁺) - u N(s⁺)`, `N(s) = s/(‖s‖ + s0)`; for s0 = 0 N(0) is the whole unit ball.

    The right-hand side is minus a monotone map, and A is positive definite: there is exactly one such s⁺. With s0 = 0
    it is exactly zero where `‖A s‖ <= u`. Else Newton's steps lead to it, from the root without P; one that does not
    halve the residual r is taken again with the chords of P, and then shorter until it is better. The residual never
    grows. The distance to s⁺ is at most ‖r‖ over A's least eigenvalue, as the right-hand side is monotone. The
    derivative is that of the solution, by the implicit function theorem.
    Source: Acary, Brogliato and Orlov, IEEE Transactions on Automatic Control 57 (2012), 1087-1101.

    - `reaching`: P and s0.
    - `metric`: A = M0/H, symmetric positive definite [n n].
    - `s`: sliding variable [n], rad/s or m/s.
    - `u`: size of the robust torque, >= 0, N m.
    """
    return _step(reaching, metric, s, u)


def _residual_and_jacobian(
    reaching: Any, metric: Matrix, push: Vector, u: Scalar, s: Vector, careful: Any = False
) -> tuple[Vector, Matrix]:
    """Residual of the equation at s, and its derivative.

    For exponents below one, Newton steps oscillate around zero. With `careful`, the slope of a power is at least its
    chord from zero, and the steps converge from everywhere.
    """
    power, slope = reaching.continuous_term_and_slope(s)
    chord = power / jnp.where(jnp.abs(s) > TINY, s, 1.0)
    slope = jnp.where(careful & (chord > slope), chord, slope)
    size = vector_norm(s)
    share = u / jnp.maximum(size + reaching.layer, TINY)
    residual = matvec(metric, s) + power + share * s - push
    # The derivative of the unit vector: share (I - s sᵀ/(‖s‖ (‖s‖ + s0))).
    turned = share / jnp.maximum(size * (size + reaching.layer), TINY)
    return residual, metric + jnp.eye(s.shape[0]) * (slope + share) - turned * s[:, None] * s[None, :]


# Traced once, and a function in exported C.
@jax.jit
def _direction(
    reaching: Any, metric: Matrix, push: Vector, u: Scalar, s: Vector, careful: Bool[Array, ""]
) -> tuple[Vector, Scalar]:
    """Newton's step from s, and the residual's length there."""
    residual, jacobian = _residual_and_jacobian(reaching, metric, push, u, s, careful)
    return -solve_symmetric(jacobian, residual), vector_norm(residual)


@eqx.filter_custom_jvp
def _step(reaching: Any, metric: Matrix, s: Vector, u: Scalar) -> Vector:
    push = matvec(metric, s)
    size = vector_norm(push)
    layer = reaching.layer

    def search() -> Vector:
        # Along the push alone the equation is a quadratic one for the length of s⁺, without the powers.
        stiffness = jnp.sum(push * matvec(metric, push)) / jnp.maximum(size * size, TINY)
        half = 0.5 * (stiffness * layer + u - size)
        root = jnp.sqrt(half * half + stiffness * layer * size)
        # The form without a difference of like numbers.
        length = jnp.where(half > 0, layer * size / jnp.maximum(half + root, TINY), (root - half) / stiffness)
        # With that length in the unit vector's denominator the equation is linear, and turns the start to the right.
        share = u / jnp.maximum(jnp.maximum(length, 0.0) + layer, TINY)
        start = solve_symmetric(metric + share * jnp.eye(s.shape[0]), push)
        tolerance = PRECISION * (1.0 + size)

        def unfinished(now: _Search) -> jax.Array:
            return (now.size > tolerance) & (now.step < STEPS)

        def direction_from(s: Vector, careful: Bool[Array, ""]) -> tuple[Vector, Scalar]:
            return _direction(reaching, metric, push, u, s, careful)

        def step(now: _Search) -> _Search:
            change = now.fraction * now.direction
            candidate = jnp.where(now.careful, now.s + change, reaching.moved(now.s, change))
            direction, length = direction_from(candidate, jnp.zeros((), bool))
            # A step that does not halve what is left, the first time, is taken again from where it began, carefully.
            better = length < jnp.where(now.careful, 1.0, 0.5) * now.size
            again = ~better & ~now.careful
            direction = jax.lax.cond(
                again,
                lambda: direction_from(now.s, jnp.ones((), bool))[0],
                lambda: jnp.where(better, direction, now.direction),
            )
            return _Search(
                s=jnp.where(better, candidate, now.s),
                size=jnp.where(better, length, now.size),
                direction=direction,
                fraction=jnp.where(better | again, 1.0, 0.5 * now.fraction),
                careful=~better,
                step=now.step + 1,
            )

        direction, length = direction_from(start, jnp.zeros((), bool))
        first = _Search(start, length, direction, jnp.ones(()), jnp.zeros((), bool), jnp.zeros((), int))
        return jax.lax.while_loop(unfinished, step, first).s

    held = (layer <= 0.0) & (size <= u)
    return jax.lax.cond(held, lambda: jnp.zeros_like(s), search)


@_step.def_jvp  # type: ignore[untyped-decorator]
def _step_jvp(primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    moving, still = eqx.partition(primals, tangent_mask(primals, tangents))
    root = _step(*primals)

    def residual(moving: Any) -> Vector:
        reaching, metric, s, u = eqx.combine(moving, still)
        return _residual_and_jacobian(reaching, metric, matvec(metric, s), u, root)[0]

    _, change = jax.jvp(residual, (moving,), (eqx.filter(tangents, tangent_mask(primals, tangents)),))
    reaching, metric, _, u = primals
    jacobian = _residual_and_jacobian(reaching, metric, root, u, root)[1]
    free = jnp.any(root != 0) | (reaching.layer > 0)
    safe = jnp.where(free, jacobian, metric)
    return root, jnp.where(free, -solve_symmetric(safe, change), 0.0)
