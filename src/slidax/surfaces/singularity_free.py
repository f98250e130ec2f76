"""The surface of the singularity-free fixed-time scheme."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import known, parameter, require, require_consistent
from slidax._types import PerJoint, Vector
from slidax.numerics import power, sig_and_slope, two_term_power_and_slope

from .surface import AbstractSurface


class SingularityFree(AbstractSurface):
    """`C1 S_α(e) + C2 Sig^β(e)`: `S_α(x) = sig^α(x)` for `|x| >= δ`, else `l1 x + l2 sig^r(x)`.

    `l1 = (r-α)/(r-1) δ^(α-1)` and `l2 = (α-1)/(r-1) δ^(α-r)` make it continuously differentiable at δ.
    The surface of the scheme that the paper cites as [24]. Reconstructed from the parameters of its Table 2; confidence
    medium.

    - `c1`, `c2`: diagonals of C1 and C2, one number or [n], rad/s or m/s, > 0.
    - `alpha`: α, exponent near zero, in (0, 1).
    - `beta`: β, exponent far from zero, > 1.
    - `r`: exponent in the core, > 1.
    - `delta`: δ, half-width of the core of S_α, > 0, rad or m.

    Raises DefinitionError if one of them is out of its range.
    """

    c1: PerJoint = eqx.field(converter=parameter)
    c2: PerJoint = eqx.field(converter=parameter)
    alpha: PerJoint = eqx.field(converter=parameter)
    beta: PerJoint = eqx.field(converter=parameter)
    r: PerJoint = eqx.field(converter=parameter)
    delta: PerJoint = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        require_consistent(self, "c1", "c2", "alpha", "beta", "r", "delta")
        require(self, "c1", known(self.c1) > 0, "must be > 0, so that C1 is diagonal positive definite ([24])")
        require(self, "c2", known(self.c2) > 0, "must be > 0, so that C2 is diagonal positive definite ([24])")
        require(self, "alpha", (known(self.alpha) > 0) & (known(self.alpha) < 1), "must be in (0, 1) ([24])")
        require(self, "beta", known(self.beta) > 1, "must be > 1 ([24])")
        require(self, "r", known(self.r) > 1, "must be > 1, so that the slope is finite at zero ([24])")
        require(self, "delta", known(self.delta) > 0, "must be > 0 ([24])")

    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`C1 S_α(e) + C2 Sig^β(e)`, and `C1 S_α'(e) + C2 β |e|^(β-1)`, both [n].

        - `eps`: error, or transformed error ε1, [n].
        """
        near, near_slope = two_term_power_and_slope(eps, self.alpha, self.r, self.delta)
        far, far_slope = sig_and_slope(eps, self.beta)
        return self.c1 * near + self.c2 * far, self.c1 * near_slope + self.c2 * far_slope

    def reach(self, pull: Vector) -> Vector:
        """`(pull/C2)^(1/β)`, [n]: the far power alone pulls as hard there.

        - `pull`: >= 0, [n], rad/s or m/s.
        """
        return power(pull / self.c2, 1.0 / self.beta)
