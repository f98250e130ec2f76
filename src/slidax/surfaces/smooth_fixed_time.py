"""The paper's smooth fixed-time terminal surface."""

from __future__ import annotations

from slidax.numerics import power, sig_and_slope, smooth_power_and_slope
from slidax.parts import PerJoint, Vector, parameter

from .surface import AbstractSurface


class SmoothFixedTime(AbstractSurface):
    """`K1 S^p(ε1) + K2 S^q(ε1)`, eqs. (29)-(40)."""

    title = "The paper's smooth fixed-time terminal surface."

    k1: PerJoint = parameter(
        "diagonal of K1", "rad/s or m/s", "> 0", "so that K1 is diagonal positive definite (eq. 40)"
    )
    k2: PerJoint = parameter(
        "diagonal of K2", "rad/s or m/s", "> 0", "so that K2 is diagonal positive definite (eq. 40)"
    )
    p: PerJoint = parameter("exponent near zero", "", "(0, 1)", "(eq. 29)")
    q: PerJoint = parameter("exponent far from zero", "", "> 1", "(eq. 34)")
    delta: PerJoint = parameter("δ, half-width of the smooth core", "", "(0, 1]", "(eq. 29)")

    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`K1 S^p(ε1) + K2 S^q(ε1)`, and `K1 F^p(ε1) + K2 H^q(ε1)` with (33), (35), (37), (39), both [n]."""
        near, near_slope = smooth_power_and_slope(eps, self.p, self.delta)
        far, far_slope = sig_and_slope(eps, self.q)
        return self.k1 * near + self.k2 * far, self.k1 * near_slope + self.k2 * far_slope

    def reach(self, pull: Vector) -> Vector:
        """`(pull/K2)^(1/q)`, [n]: the far power alone pulls as hard there."""
        return power(pull / self.k2, 1.0 / self.q)
