"""The paper's smooth fixed-time terminal surface."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import known, parameter, require, require_consistent
from slidax._types import PerJoint, Vector
from slidax.numerics import power, sig_and_slope, smooth_power_and_slope

from .surface import AbstractSurface


class SmoothFixedTime(AbstractSurface):
    """`K1 S^p(ε1) + K2 S^q(ε1)`, eqs. (29)-(40).

    - `k1`, `k2`: diagonals of K1 and K2, one number or [n], rad/s or m/s, > 0.
    - `p`: exponent near zero, in (0, 1).
    - `q`: exponent far from zero, > 1.
    - `delta`: δ, half-width of the smooth core of S^p, in (0, 1].

    Raises DefinitionError if one of them is out of its range.
    """

    k1: PerJoint = eqx.field(converter=parameter)
    k2: PerJoint = eqx.field(converter=parameter)
    p: PerJoint = eqx.field(converter=parameter)
    q: PerJoint = eqx.field(converter=parameter)
    delta: PerJoint = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        require_consistent(self, "k1", "k2", "p", "q", "delta")
        require(self, "k1", known(self.k1) > 0, "must be > 0, so that K1 is diagonal positive definite (eq. 40)")
        require(self, "k2", known(self.k2) > 0, "must be > 0, so that K2 is diagonal positive definite (eq. 40)")
        require(self, "p", (known(self.p) > 0) & (known(self.p) < 1), "must be in (0, 1) (eq. 29)")
        require(self, "q", known(self.q) > 1, "must be > 1 (eq. 34)")
        require(self, "delta", (known(self.delta) > 0) & (known(self.delta) <= 1), "must be in (0, 1] (eq. 29)")

    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`K1 S^p(ε1) + K2 S^q(ε1)`, and `K1 F^p(ε1) + K2 H^q(ε1)` with (33), (35), (37), (39), both [n].

        - `eps`: transformed error ε1 [n].
        """
        near, near_slope = smooth_power_and_slope(eps, self.p, self.delta)
        far, far_slope = sig_and_slope(eps, self.q)
        return self.k1 * near + self.k2 * far, self.k1 * near_slope + self.k2 * far_slope

    def reach(self, pull: Vector) -> Vector:
        """`(pull/K2)^(1/q)`, [n]: the far power alone pulls as hard there.

        - `pull`: >= 0, [n], rad/s or m/s.
        """
        return power(pull / self.k2, 1.0 / self.q)
