"""Reaching laws: the torque that drives the sliding variable s to zero.

The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w; numbers such as [24] are its references. Powers
keep the sign: `sig^a(x) = |x|^a sgn(x)`, and `Sig^a` for each entry of a vector. An implicit step is one implicit Euler
step over the horizon H. s⁺ is the sliding variable at the end of this step, and M0 the nominal inertia matrix.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from slidax.core.errors import DefinitionError, is_traced, require, short_repr, static_value
from slidax.core.linear_algebra import is_positive_definite, matvec, solve_symmetric
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.powers import power, saturation, sig, sig_and_slope, tangent_mask, unit_vector, vector_norm
from slidax.core.types import Matrix, PerJoint, Scalar, Vector


class AbstractReaching(AbstractPart):
    """The torque `-P(s) - u N(s)` that drives the sliding variable s to zero.

    P is the continuous term. N is the direction of the switching term, whose size u is the robust torque.
    """

    @abstractmethod
    def continuous_term(self, s: Vector) -> Vector:
        """Return the continuous term P(s), with the signs of s and 0 at s = 0, [n], N m or N.

        - `s`: sliding variable [n], rad/s or m/s.
        """

    @abstractmethod
    def switching_direction(self, s: Vector) -> Vector:
        """Return the switching direction N(s), of length 1 or less and 0 at s = 0, [n].

        - `s`: sliding variable [n], rad/s or m/s.
        """

    @abstractmethod
    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """Return s⁺ after an implicit step over the horizon H, `A (s⁺ - s) = -P(s⁺) - u N(s⁺)`, [n], rad/s or m/s.

        - `metric`: A = M0/H, symmetric positive definite [n n].
        - `s`: sliding variable [n], rad/s or m/s.
        - `u`: size of the robust torque, >= 0, N m.
        """

    def require_implicit(self) -> None:
        """Raise DefinitionError if `implicit` has no solution for these parameters; by default do nothing."""


STEPS = 64
"""Largest number of Newton steps, repeated and shortened ones included; two to four are nearly always enough."""


TINY = 1e-150
"""Lower bound of a length that is a divisor; its square does not underflow."""


@runtime_checkable
class Reaching(Protocol):
    """Reaching law for `proximal_step`: P acts on each joint alone, and `layer` is the boundary layer s0."""

    layer: Scalar

    def continuous_term_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """Return the continuous term P(s) [n], N m or N, and its derivative with respect to s [n].

        - `s`: sliding variable [n].
        """

    def moved(self, s: Vector, step: Vector) -> Vector:
        """Return s after a Newton step, [n], rad/s or m/s.

        The step may be taken in other coordinates, in which P is nearly linear, so that Newton's method converges fast.

        - `s`: sliding variable before the step [n].
        - `step`: Newton step of s [n].
        """


class _ProximalSearch(eqx.Module):
    s: Vector
    size: Scalar
    direction: Vector
    fraction: Scalar
    careful: Bool[Array, ""]
    step: Int[Array, ""]


def proximal_step(reaching: Reaching, metric: Matrix, s: Vector, u: Scalar) -> Vector:
    """Return the s⁺ with `A (s⁺ - s) = -P(s⁺) - u N(s⁺)`, `N(s) = s/(‖s‖ + s0)`, [n], rad/s or m/s.

    For s0 = 0, N(0) is the set of all vectors of length 1 or less. P and N are monotone and A is positive definite, so
    that there is exactly one s⁺. With s0 = 0, s⁺ is zero where `‖A s‖ <= u`.

    Otherwise Newton's method starts from the root of an approximate equation without P. A step that does not halve the
    residual r is repeated with the chords of P as slopes, and then shortened until r decreases. r never grows. The
    distance to s⁺ is at most ‖r‖ over A's least eigenvalue. Derivatives follow from the implicit function theorem.
    Source: Acary, Brogliato and Orlov, IEEE Transactions on Automatic Control 57 (2012), 1087-1101.

    - `reaching`: reaching law, with P and s0.
    - `metric`: A = M0/H, symmetric positive definite [n n].
    - `s`: sliding variable [n], rad/s or m/s.
    - `u`: size of the robust torque, >= 0, N m.
    """
    return _solve_proximal_step(reaching, metric, s, u)


def _residual_and_jacobian(
    reaching: Any, metric: Matrix, target: Vector, u: Scalar, s: Vector, careful: Any = False
) -> tuple[Vector, Matrix]:
    """Return the residual of `proximal_step` at s [n], and its derivative [n n].

    For exponents below one, Newton steps oscillate around zero. With `careful`, the slope of a power is at least its
    chord from zero, and the steps converge from everywhere.
    """
    power, slope = reaching.continuous_term_and_slope(s)
    chord = power / jnp.where(jnp.abs(s) > TINY, s, 1.0)
    slope = jnp.where(careful & (chord > slope), chord, slope)
    size = vector_norm(s)
    share = u / jnp.maximum(size + reaching.layer, TINY)
    residual = matvec(metric, s) + power + share * s - target
    # The derivative of the unit vector: share (I - s sᵀ/(‖s‖ (‖s‖ + s0))).
    turned = share / jnp.maximum(size * (size + reaching.layer), TINY)
    return residual, metric + jnp.eye(s.shape[0]) * (slope + share) - turned * s[:, None] * s[None, :]


# Traced once, and a function in exported C.
@jax.jit
def _direction(
    reaching: Any, metric: Matrix, target: Vector, u: Scalar, s: Vector, careful: Bool[Array, ""]
) -> tuple[Vector, Scalar]:
    """Return Newton's step from s, and the norm of the residual at s."""
    residual, jacobian = _residual_and_jacobian(reaching, metric, target, u, s, careful)
    return -solve_symmetric(jacobian, residual), vector_norm(residual)


@eqx.filter_custom_jvp
def _solve_proximal_step(reaching: Any, metric: Matrix, s: Vector, u: Scalar) -> Vector:
    target = matvec(metric, s)
    size = vector_norm(target)
    layer = reaching.layer

    def search() -> Vector:
        # For an s⁺ along the target, without the powers, the equation is quadratic in the length of s⁺.
        stiffness = jnp.sum(target * matvec(metric, target)) / jnp.maximum(size * size, TINY)
        half = 0.5 * (stiffness * layer + u - size)
        root = jnp.sqrt(half * half + stiffness * layer * size)
        # This form avoids the difference of two nearly equal numbers.
        length = jnp.where(half > 0, layer * size / jnp.maximum(half + root, TINY), (root - half) / stiffness)
        # With that length in the unit vector's denominator the equation is linear, which corrects the direction.
        share = u / jnp.maximum(jnp.maximum(length, 0.0) + layer, TINY)
        start = solve_symmetric(metric + share * jnp.eye(s.shape[0]), target)
        tolerance = PRECISION * (1.0 + size)

        def unfinished(now: _ProximalSearch) -> jax.Array:
            return (now.size > tolerance) & (now.step < STEPS)

        def direction_from(s: Vector, careful: Bool[Array, ""]) -> tuple[Vector, Scalar]:
            return _direction(reaching, metric, target, u, s, careful)

        def step(now: _ProximalSearch) -> _ProximalSearch:
            change = now.fraction * now.direction
            candidate = jnp.where(now.careful, now.s + change, reaching.moved(now.s, change))
            direction, length = direction_from(candidate, jnp.zeros((), bool))
            # The first time that a step does not halve the residual, it is repeated from its start with the chords.
            better = length < jnp.where(now.careful, 1.0, 0.5) * now.size
            again = ~better & ~now.careful
            direction = jax.lax.cond(
                again,
                lambda: direction_from(now.s, jnp.ones((), bool))[0],
                lambda: jnp.where(better, direction, now.direction),
            )
            return _ProximalSearch(
                s=jnp.where(better, candidate, now.s),
                size=jnp.where(better, length, now.size),
                direction=direction,
                fraction=jnp.where(better | again, 1.0, 0.5 * now.fraction),
                careful=~better,
                step=now.step + 1,
            )

        direction, length = direction_from(start, jnp.zeros((), bool))
        first = _ProximalSearch(start, length, direction, jnp.ones(()), jnp.zeros((), bool), jnp.zeros((), int))
        return jax.lax.while_loop(unfinished, step, first).s

    held = (layer <= 0.0) & (size <= u)
    return jax.lax.cond(held, lambda: jnp.zeros_like(s), search)


@_solve_proximal_step.def_jvp  # type: ignore[untyped-decorator]
def _solve_proximal_step_jvp(primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    moving, still = eqx.partition(primals, tangent_mask(primals, tangents))
    root = _solve_proximal_step(*primals)

    def residual(moving: Any) -> Vector:
        reaching, metric, s, u = eqx.combine(moving, still)
        return _residual_and_jacobian(reaching, metric, matvec(metric, s), u, root)[0]

    _, change = jax.jvp(residual, (moving,), (eqx.filter(tangents, tangent_mask(primals, tangents)),))
    reaching, metric, _, u = primals
    jacobian = _residual_and_jacobian(reaching, metric, root, u, root)[1]
    free = jnp.any(root != 0) | (reaching.layer > 0)
    safe = jnp.where(free, jacobian, metric)
    return root, jnp.where(free, -solve_symmetric(safe, change), 0.0)


class FixedTimeReaching(AbstractReaching):
    """Torque `-K0 Sig^r(s) - u s/(‖s‖ + s0)`, the paper's eqs. (43) and (51), or (44) for s0 = 0.

    s is the sliding variable, u the size of the robust torque, and `Sig^r(s) = |s|^r sgn(s)` for each joint.
    """

    title = "The reaching law of the paper: a power and a unit vector, discontinuous or smoothed."

    gain: PerJoint = parameter("K0, symmetric positive definite", "N m or N", matrix=True)
    exponent: Scalar = parameter("r, exponent of the power of s", "", "> 1", "(r, eq. 43)")
    layer: Scalar = parameter(
        "s0, width of the boundary layer",
        "rad/s or m/s",
        ">= 0",
        "(s0, eq. 51; 0 gives the unit vector of eq. 44)",
        default=0.0,
    )

    def __check_init__(self) -> None:
        rule = "must be symmetric positive definite (K0, eq. 43)"
        if self.gain.ndim < 2:
            require(self, "gain", static_value(self.gain) > 0, rule)
        elif not is_traced(self.gain):
            matrix = np.asarray(self.gain)
            if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not is_positive_definite(matrix):
                raise DefinitionError(f"`FixedTimeReaching.gain` {rule}; got {short_repr(matrix)}")

    def continuous_term(self, s: Vector) -> Vector:
        """`K0 Sig^r(s)`, [n], N m or N."""
        powers = sig(s, self.exponent)
        return matvec(self.gain, powers) if self.gain.ndim == 2 else self.gain * powers

    def switching_direction(self, s: Vector) -> Vector:
        """`s/(‖s‖ + s0)`, [n], and 0 at s = 0."""
        return unit_vector(s, self.layer)

    def continuous_term_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """`K0 Sig^r(s)` and its derivative, [n], for a diagonal K0."""
        powers, slope = sig_and_slope(s, self.exponent)
        return self.gain * powers, self.gain * slope

    def moved(self, s: Vector, step: Vector) -> Vector:
        """Return `s + step`, [n]: for a power above one Newton's method needs no other coordinates."""
        return s + step

    def require_implicit(self) -> None:
        """Raise DefinitionError if K0 is a full matrix: K0 Sig^r is not monotone then, and s⁺ may not exist."""
        if self.gain.ndim == 2:
            raise DefinitionError(
                "`FixedTimeReaching.gain` must be one number or a diagonal [n] for an implicit step, since a full "
                f"matrix times Sig^r is not monotone (K0, eq. 43); got shape {list(self.gain.shape)}"
            )

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """Return s⁺ of the implicit step, [n]; raises DefinitionError as `require_implicit`."""
        self.require_implicit()
        return proximal_step(self, metric, s, u)


LEAST = 1e-30
"""Distance from zero [rad/s or m/s] within which a power below one is linear, so that its slope is finite."""


class TwoPowerReaching(AbstractReaching):
    """Torque `-K1 Sig^v1(s) - K2 Sig^v2(s) - u s/(‖s‖ + s0)`, `v1 > 1 > v2`: fast far from 0, in finite time near it.

    The reaching law of the scheme that the paper cites as [24]. Reconstructed from the parameters in the paper's
    Table 2, with medium confidence. `Sig^v(s) = |s|^v sgn(s)`.
    """

    title = "The reaching law with two powers, above and below one."

    k1: PerJoint = parameter("diagonal of K1", "N m or N", "> 0", "so that K1 is diagonal positive definite ([24])")
    k2: PerJoint = parameter("diagonal of K2", "N m or N", "> 0", "so that K2 is diagonal positive definite ([24])")
    v1: Scalar = parameter("exponent far from the surface", "", "> 1", "([24])")
    v2: Scalar = parameter("exponent near the surface", "", "(0, 1)", "([24])")
    layer: Scalar = parameter(
        "s0, width of the boundary layer",
        "rad/s or m/s",
        ">= 0",
        "(s0, eq. 51; 0 gives the unit vector of eq. 44)",
        default=0.0,
    )

    def continuous_term(self, s: Vector) -> Vector:
        """`K1 Sig^v1(s) + K2 Sig^v2(s)`, [n], N m or N."""
        return self.k1 * sig(s, self.v1) + self.k2 * sig(s, self.v2)

    def switching_direction(self, s: Vector) -> Vector:
        """`s/(‖s‖ + s0)`, [n], and 0 at s = 0."""
        return unit_vector(s, self.layer)

    def continuous_term_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """`K1 Sig^v1(s) + K2 Sig^v2(s)` and its derivative, [n]; for `|s| < 1e-30` the second term is linear in s."""
        far, far_slope = sig_and_slope(s, self.v1)
        ratio, near_slope = self._near(s)
        return self.k1 * far + self.k2 * s * ratio, self.k1 * far_slope + self.k2 * near_slope

    def moved(self, s: Vector, step: Vector) -> Vector:
        """Return s after a Newton step in the coordinates `sig^v2(s)`, [n], which does not jump over zero."""
        ratio, slope = self._near(s)
        near = s * ratio + slope * step
        straight, _ = self._near(jnp.zeros_like(s))
        return jnp.where(jnp.abs(near) > LEAST * straight, sig(near, 1.0 / self.v2), near / straight)

    def _near(self, s: Vector) -> tuple[Vector, Vector]:
        """`|s|^(v2 - 1)` and the slope of `sig^v2`; within `LEAST` of 0 a straight line keeps both finite."""
        ratio = power(jnp.maximum(jnp.abs(s), LEAST), self.v2 - 1.0)
        return ratio, jnp.where(jnp.abs(s) > LEAST, self.v2, 1.0) * ratio

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        return proximal_step(self, metric, s, u)


SWEEPS = 2000
"""Largest number of sweeps over the joints; ten to fifty are enough for arms."""

PRECISION = 2e-13
"""Tolerance of the residual, relative to 1 plus the size of `A s`."""


class SaturatedReaching(AbstractReaching):
    """Torque `-K_D s - u w ∘ sat(s/φ)`, with the product ∘ of entries.

    For φ = 0 sat is the sign, which is set-valued at 0 in the implicit step.
    Source: Slotine and Li, Applied Nonlinear Control, 1991, chapters 7 and 9, with the gain `K = u w`.
    """

    title = "The textbook reaching law: damping, and a saturated torque for each joint."

    damping: PerJoint = parameter("diagonal of K_D", "N m s/rad or N s/m", ">= 0", "(K_D; Slotine and Li, 1991)")
    weights: PerJoint = parameter("w, each joint's share of u, ‖w‖ <= 1", "", "[0, 1]", "as a joint's share of u")
    layer: PerJoint = parameter(
        "φ, half-width of the boundary layer", "rad/s or m/s", ">= 0", "(the boundary layer φ; 0 gives the sign)"
    )

    def continuous_term(self, s: Vector) -> Vector:
        """`K_D s`, [n], N m or N."""
        return self.damping * s

    def switching_direction(self, s: Vector) -> Vector:
        """`w ∘ sat(s/φ)`, [n]."""
        return self.weights * saturation(s, self.layer)

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """Return s⁺ of the implicit step, [n], by Gauss-Seidel iteration, which converges for every `metric`."""
        return _step(self, metric, s, u)


class _Sweep(eqx.Module):
    s: Vector
    change: Scalar
    count: Int[Array, ""]


def _parts(law: SaturatedReaching, u: Scalar, n: int) -> tuple[Vector, Vector, Vector]:
    """K_D, K and φ, each [n]."""
    damping, gain, layer = (jnp.broadcast_to(x, (n,)) for x in (law.damping, u * law.weights, law.layer))
    return damping, gain, layer


@eqx.filter_custom_jvp
def _step(law: Any, metric: Matrix, s: Vector, u: Scalar) -> Vector:
    n = s.shape[0]
    damping, gain, layer = _parts(law, u, n)
    target = matvec(metric, s)
    stiffness = jnp.diagonal(metric) + damping
    edge = gain + stiffness * layer
    inner = jnp.where(layer > 0, 1.0 / (stiffness + gain / jnp.where(layer > 0, layer, 1.0)), 0.0)
    tolerance = 0.1 * PRECISION * (1.0 + jnp.max(jnp.abs(target)))

    def sweep(now: _Sweep) -> _Sweep:
        x = [now.s[i] for i in range(n)]
        change = jnp.zeros(())
        for i in range(n):
            rest = target[i] - sum((metric[i, j] * x[j] for j in range(n) if j != i), start=jnp.zeros(()))
            outer = (rest - jnp.sign(rest) * gain[i]) / stiffness[i]
            new = jnp.where(jnp.abs(rest) <= edge[i], rest * inner[i], outer)
            change = jnp.maximum(change, stiffness[i] * jnp.abs(new - x[i]))
            x[i] = new
        return _Sweep(jnp.stack(x), change, now.count + 1)

    def unfinished(now: _Sweep) -> Bool[Array, ""]:
        return (now.change > tolerance) & (now.count < SWEEPS)

    first = _Sweep(jnp.zeros_like(s), jnp.full((), jnp.inf), jnp.zeros((), int))
    return jax.lax.while_loop(unfinished, sweep, first).s


@_step.def_jvp  # type: ignore[untyped-decorator]
def _step_jvp(primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    mask = tangent_mask(primals, tangents)
    moving, still = eqx.partition(primals, mask)
    root = _step(*primals)

    def residual(moving: Any) -> Vector:
        law, metric, s, u = eqx.combine(moving, still)
        return matvec(metric, root - s) + law.continuous_term(root) + u * law.switching_direction(root)

    _, change = jax.jvp(residual, (moving,), (eqx.filter(tangents, mask),))
    law, metric, _, u = primals
    damping, gain, layer = _parts(law, u, root.shape[0])
    stuck = (root == 0) & (layer <= 0)
    within = (jnp.abs(root) < layer) & ~stuck
    slope = damping + jnp.where(within, gain / jnp.where(within, layer, 1.0), 0.0)
    # A joint that is stuck at 0 stays there: its row and column are those of the identity.
    free = ~stuck
    both = free[:, None] & free[None, :]
    jacobian = jnp.where(both, metric, 0.0) + jnp.diag(jnp.where(free, slope, 1.0))
    return root, -solve_symmetric(jacobian, jnp.where(free, change, 0.0))
