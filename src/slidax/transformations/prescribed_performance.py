"""The logarithmic transformation that turns an envelope into the whole line."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax._errors import parameter, require
from slidax._types import Envelope, PerJoint, Scalar, Vector
from slidax.performance import AbstractPerformance

from .transformation import AbstractTransformation, TransformedError


class Sides(eqx.Module):
    """The two sides of the envelope as fractions of ρ, `lower ρ < e < upper ρ`, eq. (13).

    - `lower`: b, [n], in [-1, 0).
    - `upper`: b̄, [n], in (0, 1].
    """

    lower: Vector
    upper: Vector


def psi(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """`ψ(x) = b b̄ (eˣ - 1)/(b eˣ - b̄)`, eq. (21): increasing, from b at -∞ to b̄ at +∞, and 0 at 0.

    - `x`: transformed error.
    - `sides`: b and b̄, broadcast with `x`.
    """
    b, b_bar = sides.lower, sides.upper
    # Each branch keeps the exponential below one, so that no argument overflows.
    z = jnp.exp(-jnp.abs(x))
    small = -jnp.expm1(-jnp.abs(x))
    return jnp.where(x >= 0, b * b_bar * small / (b - b_bar * z), -b * b_bar * small / (b * z - b_bar))


def psi_inverse(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """`ψ⁻¹(x) = ln( b̄ (x - b) / (-b (b̄ - x)) )`, eq. (23); NaN outside (b, b̄).

    - `x`: error over radius, e/ρ.
    - `sides`: b and b̄, broadcast with `x`.
    """
    b, b_bar = sides.lower, sides.upper
    return jnp.log(b_bar * (x - b) / (-b * (b_bar - x)))


def psi_inverse_slope(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """`v(x) = 1/(x - b) + 1/(b̄ - x)`, eq. (27), over a common denominator.

    - `x`: error over radius, e/ρ.
    - `sides`: b and b̄, broadcast with `x`.
    """
    return (sides.upper - sides.lower) / ((x - sides.lower) * (sides.upper - x))


class PrescribedPerformance(AbstractTransformation):
    """`ε1 = ψ⁻¹(e/ρ)`, eq. (24), with `ψ⁻¹` of (23): an error inside the envelope becomes any real number.

    The side of the envelope towards the initial error has the full width ρ, the other ϑ ρ, eq. (13).

    - `performance`: ρ(t).
    - `overshoot`: ϑ, one number or [n], in (0, 1).

    Raises DefinitionError if the overshoot is out of its range.
    """

    performance: AbstractPerformance
    overshoot: PerJoint = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        require(self, "overshoot", (self.overshoot > 0) & (self.overshoot < 1), "must be in (0, 1) (eq. 13)")

    def init(self, t: Scalar, e: Vector) -> Sides:
        """The sides by the sign of the initial error, eq. (13).

        - `t`: time at the start [s].
        - `e`: error at the start [n].
        """
        return Sides(lower=jnp.where(e >= 0, -self.overshoot, -1.0), upper=jnp.where(e >= 0, 1.0, self.overshoot))

    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: Sides) -> TransformedError:
        """Eqs. (24)-(28), with `Ȧ = diag(-(ρ̈ρ - ρ̇²)/ρ²)`.

        - `t`: time [s].
        - `e`, `de`: error and its rate [n].
        - `memory`: the sides.
        """
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
        """`b ρ(t) < e < b̄ ρ(t)`, eq. (12).

        - `t`: time [s].
        - `memory`: the sides.
        """
        rho = self.performance.radius(t)
        return Envelope(lower=memory.lower * rho, upper=memory.upper * rho)
