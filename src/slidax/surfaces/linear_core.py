"""An earlier fixed-time terminal surface, with a kink at the edge of its linear core."""

from __future__ import annotations

from slidax.numerics import linear_core_power_and_slope, power, sig_and_slope
from slidax.parts import PerJoint, Vector, parameter

from .surface import AbstractSurface


class LinearCoreFixedTime(AbstractSurface):
    """`K1 Ŝ^p(ε1) + K2 Sig^q(ε1)` with `ŝ^p` of (78): `sig^p(x)` for `|x| >= δ`, else `δ^(p-1) x`.

    The surface of the schemes that the paper cites as [23] and [33], as it describes them at (78), (79): continuous,
    with a slope that jumps at δ, and so a torque that does.
    """

    title = "An earlier fixed-time terminal surface, with a kink at the edge of its linear core."

    k1: PerJoint = parameter(
        "diagonal of K1", "rad/s or m/s", "> 0", "so that K1 is diagonal positive definite (eq. 40)"
    )
    k2: PerJoint = parameter(
        "diagonal of K2", "rad/s or m/s", "> 0", "so that K2 is diagonal positive definite (eq. 40)"
    )
    p: PerJoint = parameter("exponent near zero", "", "(0, 1)", "(eq. 78)")
    q: PerJoint = parameter("exponent far from zero", "", "> 1", "(eq. 34)")
    delta: PerJoint = parameter("δ, half-width of the straight core", "", "(0, 1]", "(eq. 78)")

    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`K1 Ŝ^p(ε1) + K2 Sig^q(ε1)`, and `K1 F̂^p(ε1) + K2 H^q(ε1)`, both [n]; at |ε1| = δ the outer slope."""
        near, near_slope = linear_core_power_and_slope(eps, self.p, self.delta)
        far, far_slope = sig_and_slope(eps, self.q)
        return self.k1 * near + self.k2 * far, self.k1 * near_slope + self.k2 * far_slope

    def reach(self, pull: Vector) -> Vector:
        """`(pull/K2)^(1/q)`, [n]: the far power alone pulls as hard there."""
        return power(pull / self.k2, 1.0 / self.q)
