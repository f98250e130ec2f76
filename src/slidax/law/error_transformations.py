"""Error transformations: from the tracking error in its envelope to the transformed error.

The led error `y = e + c ė` is the error e extrapolated by the lead time c. The envelope of e has the radius ρ, that of
y the led radius `ρ + c ρ̇`. The horizon H is the time over which a sampled-data law plans in each period. The paper is
Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w.
"""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Envelope, Memory, PerJoint, Scalar, Vector

from .envelopes import AbstractPerformance


class Sides(eqx.Module):
    """The two sides of the envelope as fractions of ρ, `lower ρ < e < upper ρ`, the paper's eq. (13).

    - `lower`: b, [n], in [-1, 0).
    - `upper`: b̄, [n], in (0, 1].
    """

    lower: Vector
    upper: Vector


def psi(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """Return e/ρ for a transformed error x: `ψ(x) = b b̄ (eˣ - 1)/(b eˣ - b̄)`, the paper's eq. (21).

    ψ increases from b at -∞ to b̄ at +∞, and is 0 at 0.

    - `x`: transformed error.
    - `sides`: b and b̄, broadcast with `x`.
    """
    return psi_and_slope(x, sides)[0]


def psi_and_slope(x: Float[Array, "..."], sides: Sides) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Return `ψ(x) = b b̄ (eˣ - 1)/(b eˣ - b̄)`, the paper's eq. (21), and `ψ' = b b̄ (b - b̄) eˣ/(b eˣ - b̄)² > 0`.

    - `x`: transformed error.
    - `sides`: b and b̄, broadcast with `x`.
    """
    b, b_bar = sides.lower, sides.upper
    # Each branch keeps the exponential below one, so that no argument overflows.
    small = -jnp.expm1(-jnp.abs(x))
    z = 1.0 - small
    above = x >= 0
    inverse = 1.0 / jnp.where(above, b - b_bar * z, b * z - b_bar)
    share = b * b_bar * inverse
    return jnp.where(above, share, -share) * small, share * inverse * (b - b_bar) * z


def psi_inverse(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """Return the transformed error `ψ⁻¹(x) = ln( b̄ (x - b) / (-b (b̄ - x)) )`, the paper's eq. (23); NaN outside (b, b̄).

    - `x`: error over radius, e/ρ.
    - `sides`: b and b̄, broadcast with `x`.
    """
    b, b_bar = sides.lower, sides.upper
    return jnp.log(b_bar * (x - b) / (-b * (b_bar - x)))


def psi_inverse_slope(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """Return the derivative of `ψ⁻¹`, `1/(x - b) + 1/(b̄ - x)`, the paper's eq. (27).

    - `x`: error over radius, e/ρ.
    - `sides`: b and b̄, broadcast with `x`.
    """
    return (sides.upper - sides.lower) / ((x - sides.lower) * (sides.upper - x))


class EnvelopeFrame(eqx.Module):
    """Envelope of the led error y, now and one horizon H later: `b now < y < b̄ now`, with the sides b and b̄.

    - `now`: led radius now, `ρ + c ρ̇` with c of `y = e + c ė`, [n], rad or m; 1 without an envelope.
    - `ahead`: its tangent one horizon later, `now + H (ρ̇ + c ρ̈)`, [n], rad or m; 1 without an envelope.
    - `sides`: b and b̄ [n]; None without an envelope.
    """

    now: PerJoint
    ahead: PerJoint
    sides: Sides | None

    def psi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return the normalised led error `ψ(ε)`, see `psi`, and its derivative `ψ'(ε)`, [n] each.

        `now ψ(ε)` is a led error at the present time, `ahead ψ(ε)` one horizon later. Without an envelope ψ(ε) = ε.

        - `eps`: transformed error ε [n].
        """
        if self.sides is None:
            return eps, jnp.ones_like(eps)
        return psi_and_slope(eps, self.sides)

    def transformed(self, y: Vector) -> Vector:
        """Return the transformed error `ψ⁻¹(y/now)` of a led error y at the present time, [n].

        y is first clipped to 1 - 1e-9 of its envelope, so that the result is finite for every y.

        - `y`: led error [n], rad or m.
        """
        if self.sides is None:
            return y
        lower, upper = self.sides.lower, self.sides.upper
        inside = 1.0 - 1e-9
        return psi_inverse(jnp.clip(y / self.now, inside * lower, inside * upper), self.sides)


class TransformedError(eqx.Module):
    """The transformed error ε1 and its rate, `ε̇1 = ε2 = B (ė + A e)`, the paper's eqs. (25)-(28). All [n].

    - `eps1`: transformed error ε1.
    - `eps2`: its rate ε2, 1/s.
    - `beta`: diagonal of `B = ∂ε1/∂e`, 1/rad or 1/m.
    - `alpha`: diagonal of A, `-ρ̇/ρ` of the envelope's radius ρ, 1/s; 0 without an envelope.
    - `alpha_rate`: diagonal of Ȧ, 1/s².
    """

    eps1: Vector
    eps2: Vector
    beta: Vector
    alpha: PerJoint
    alpha_rate: PerJoint


class AbstractTransformation(AbstractPart):
    """A map from error and time to the transformed error. The initial error selects the sides of the envelope."""

    @abstractmethod
    def init(self, t: Scalar, e: Vector) -> Memory:
        """Return the memory of the transformation, any pytree of arrays, from the error at the start.

        - `t`: time at the start [s].
        - `e`: error at the start [n].
        """

    @abstractmethod
    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: Memory) -> TransformedError:
        """Return the transformed error.

        - `t`: time [s].
        - `e`, `de`: error and its rate [n].
        - `memory`: from `init`.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """Return the bounds that the error must keep; None if there are none.

        - `t`: time [s].
        - `memory`: from `init`.
        """

    @abstractmethod
    def frame(self, t: Scalar, lead_time: Scalar, horizon: Scalar, memory: Memory) -> EnvelopeFrame:
        """Return the envelope of the led error now and one horizon later, for a law with an implicit step.

        - `t`: time [s].
        - `lead_time`: c of the led error `e + c ė` [s].
        - `horizon`: H, over which the law plans [s].
        - `memory`: from `init`.
        """


SLIMMEST = 0.1
"""Least led radius over the radius ρ. The led radius is raised to it while the envelope narrows fast."""


class PrescribedPerformance(AbstractTransformation):
    """`ε1 = ψ⁻¹(e/ρ)`, the paper's eqs. (23), (24): an error inside the envelope becomes any real number.

    The side of the envelope towards the initial error has the width ρ, the other side ϑ ρ.
    """

    title = "The logarithmic transformation from the envelope to all real numbers."

    performance: AbstractPerformance = piece("ρ(t), the radius of the envelope")
    overshoot: PerJoint = parameter("ϑ, width over ρ of the side away from the initial error", "", "(0, 1)", "(eq. 13)")

    def init(self, t: Scalar, e: Vector) -> Sides:
        """Return the sides of the envelope, which follow from the sign of the initial error (the paper's eq. 13)."""
        return Sides(lower=jnp.where(e >= 0, -self.overshoot, -1.0), upper=jnp.where(e >= 0, 1.0, self.overshoot))

    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: Sides) -> TransformedError:
        """Return the transformed error by the paper's eqs. (24)-(28), with `Ȧ = diag(-(ρ̈ρ - ρ̇²)/ρ²)`."""
        rho, drho, ddrho = self.performance.radius_rate_curvature(t)
        # One division, and it does not wait for the error.
        inverse = 1.0 / rho
        x = e * inverse
        alpha = -drho * inverse
        alpha_rate = alpha * alpha - ddrho * inverse
        beta = psi_inverse_slope(x, memory) * inverse
        return TransformedError(
            eps1=psi_inverse(x, memory),
            eps2=beta * (de + alpha * e),
            beta=beta,
            alpha=alpha,
            alpha_rate=alpha_rate,
        )

    def envelope(self, t: Scalar, memory: Sides) -> Envelope:
        """Return the bounds `b ρ(t) < e < b̄ ρ(t)`, the paper's eq. (12)."""
        rho = self.performance.radius(t)
        return Envelope(lower=memory.lower * rho, upper=memory.upper * rho)

    def frame(self, t: Scalar, lead_time: Scalar, horizon: Scalar, memory: Sides) -> EnvelopeFrame:
        """Return the envelope of the led error now and, along its tangent, one horizon later.

        Both radii are at least 0.1 ρ.
        """
        rho, drho, ddrho = self.performance.radius_rate_curvature(t)
        slimmest = SLIMMEST * rho
        now = jnp.maximum(rho + lead_time * drho, slimmest)
        ahead = jnp.maximum(now + horizon * (drho + lead_time * ddrho), slimmest)
        shape = memory.lower.shape
        return EnvelopeFrame(now=jnp.broadcast_to(now, shape), ahead=jnp.broadcast_to(ahead, shape), sides=memory)


class Unconstrained(AbstractTransformation):
    """`ε1 = e`, `ε2 = ė`, `B = I`, `A = Ȧ = 0`: the paper's eqs. (40)-(45) then give a law without an envelope."""

    title = "The identity, for schemes without an envelope."

    def init(self, t: Scalar, e: Vector) -> tuple[()]:
        return ()

    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: tuple[()]) -> TransformedError:
        """Return the error and its rate unchanged, rad and rad/s, or m and m/s."""
        zero = jnp.zeros_like(e)
        return TransformedError(eps1=e, eps2=de, beta=jnp.ones_like(e), alpha=zero, alpha_rate=zero)

    def envelope(self, t: Scalar, memory: tuple[()]) -> None:
        return None

    def frame(self, t: Scalar, lead_time: Scalar, horizon: Scalar, memory: tuple[()]) -> EnvelopeFrame:
        half_width = jnp.ones(())
        return EnvelopeFrame(now=half_width, ahead=half_width, sides=None)
