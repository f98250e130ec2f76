"""The logarithmic transformation from the envelope to all real numbers."""

from __future__ import annotations

import jax.numpy as jnp

from slidax._types import Envelope
from slidax.parts import PerJoint, Scalar, Vector, parameter, piece
from slidax.performance import AbstractPerformance

from .frame import Frame
from .psi import Sides, psi_inverse, psi_inverse_slope
from .transformation import AbstractTransformation, TransformedError

SLIMMEST = 0.1
"""A plan's frame is never narrower than this share of the envelope, however fast that narrows."""


class PrescribedPerformance(AbstractTransformation):
    """`ε1 = ψ⁻¹(e/ρ)`, eq. (24), with `ψ⁻¹` of (23): an error inside the envelope becomes any real number.

    The side of the envelope towards the initial error has the full width ρ, the other ϑ ρ, eq. (13).
    """

    title = "The logarithmic transformation from the envelope to all real numbers."

    performance: AbstractPerformance = piece("ρ(t), the radius of the envelope")
    overshoot: PerJoint = parameter("ϑ, width of the side away from the initial error over ρ", "", "(0, 1)", "(eq. 13)")

    def init(self, t: Scalar, e: Vector) -> Sides:
        """The sides by the sign of the initial error, eq. (13)."""
        return Sides(lower=jnp.where(e >= 0, -self.overshoot, -1.0), upper=jnp.where(e >= 0, 1.0, self.overshoot))

    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: Sides) -> TransformedError:
        """Eqs. (24)-(28), with `Ȧ = diag(-(ρ̈ρ - ρ̇²)/ρ²)`."""
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
        """`b ρ(t) < e < b̄ ρ(t)`, eq. (12)."""
        rho = self.performance.radius(t)
        return Envelope(lower=memory.lower * rho, upper=memory.upper * rho)

    def frame(self, t: Scalar, lead: Scalar, horizon: Scalar, memory: Sides) -> Frame:
        """The envelope of the led error, and its tangent one horizon later."""
        rho, drho, ddrho = self.performance.radius_rate_curvature(t)
        slimmest = SLIMMEST * rho
        now = jnp.maximum(rho + lead * drho, slimmest)
        ahead = jnp.maximum(now + horizon * (drho + lead * ddrho), slimmest)
        shape = memory.lower.shape
        return Frame(now=jnp.broadcast_to(now, shape), ahead=jnp.broadcast_to(ahead, shape), sides=memory)
