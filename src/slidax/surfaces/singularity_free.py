"""The surface of the singularity-free fixed-time scheme."""

from __future__ import annotations

from slidax.numerics import power, sig_and_slope, two_term_power_and_slope
from slidax.parts import PerJoint, Vector, parameter

from .surface import AbstractSurface


class SingularityFree(AbstractSurface):
    """`C1 S_α(e) + C2 Sig^β(e)`: `S_α(x) = sig^α(x)` for `|x| >= δ`, else `l1 x + l2 sig^r(x)`.

    `l1 = (r-α)/(r-1) δ^(α-1)` and `l2 = (α-1)/(r-1) δ^(α-r)` make it continuously differentiable at δ.
    The surface of the scheme that the paper cites as [24]. Reconstructed from the parameters of its Table 2; confidence
    medium.
    """

    title = "The surface of the singularity-free fixed-time scheme."

    c1: PerJoint = parameter("diagonal of C1", "rad/s or m/s", "> 0", "so that C1 is diagonal positive definite ([24])")
    c2: PerJoint = parameter("diagonal of C2", "rad/s or m/s", "> 0", "so that C2 is diagonal positive definite ([24])")
    alpha: PerJoint = parameter("α, exponent near zero", "", "(0, 1)", "([24])")
    beta: PerJoint = parameter("β, exponent far from zero", "", "> 1", "([24])")
    r: PerJoint = parameter("exponent in the core", "", "> 1", "so that the slope is finite at zero ([24])")
    delta: PerJoint = parameter("δ, half-width of the core", "rad or m", "> 0", "([24])")

    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`C1 S_α(e) + C2 Sig^β(e)`, and `C1 S_α'(e) + C2 β |e|^(β-1)`, both [n]."""
        near, near_slope = two_term_power_and_slope(eps, self.alpha, self.r, self.delta)
        far, far_slope = sig_and_slope(eps, self.beta)
        return self.c1 * near + self.c2 * far, self.c1 * near_slope + self.c2 * far_slope

    def reach(self, pull: Vector) -> Vector:
        """`(pull/C2)^(1/β)`, [n]: the far power alone pulls as hard there."""
        return power(pull / self.c2, 1.0 / self.beta)
