"""The reaching law with two powers, one for each side of one."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import parameter, require, require_consistent, require_shape
from slidax._types import PerJoint, Scalar, Vector
from slidax.numerics import sig, unit_vector

from .reaching import AbstractReaching


class TwoPowerReaching(AbstractReaching):
    """`-K1 Sig^v1(s) - K2 Sig^v2(s) - u s/(‖s‖ + s0)`, with `v1 > 1 > v2`: fast from far, and finite in time when near.

    The reaching law of the scheme that the paper cites as [24]. Reconstructed from the parameters of its Table 2;
    confidence medium.

    - `k1`, `k2`: diagonals of K1 and K2, one number or [n], N m or N, > 0.
    - `v1`: exponent far from the surface, one number, > 1.
    - `v2`: exponent near the surface, one number, in (0, 1).
    - `layer`: s0, width of the boundary layer, rad/s or m/s, one number >= 0; 0 gives the unit vector.

    Raises DefinitionError if one of them is out of its range.
    """

    k1: PerJoint = eqx.field(converter=parameter)
    k2: PerJoint = eqx.field(converter=parameter)
    v1: Scalar = eqx.field(converter=parameter)
    v2: Scalar = eqx.field(converter=parameter)
    layer: Scalar = eqx.field(converter=parameter, default=0.0)

    def __check_init__(self) -> None:
        require_consistent(self, "k1", "k2")
        require_shape(self, (), "v1", "v2", "layer")
        require(self, "k1", self.k1 > 0, "must be > 0, so that K1 is diagonal positive definite ([24])")
        require(self, "k2", self.k2 > 0, "must be > 0, so that K2 is diagonal positive definite ([24])")
        require(self, "v1", self.v1 > 1, "must be > 1 ([24])")
        require(self, "v2", (self.v2 > 0) & (self.v2 < 1), "must be in (0, 1) ([24])")
        require(self, "layer", self.layer >= 0, "must be >= 0 (s0, eq. 51; 0 gives the unit vector of eq. 44)")

    def power(self, s: Vector) -> Vector:
        """`K1 Sig^v1(s) + K2 Sig^v2(s)`, [n], N m or N.

        - `s`: sliding variable [n], rad/s or m/s.
        """
        return self.k1 * sig(s, self.v1) + self.k2 * sig(s, self.v2)

    def direction(self, s: Vector) -> Vector:
        """`s/(‖s‖ + s0)`, [n], and 0 at s = 0.

        - `s`: sliding variable [n], rad/s or m/s.
        """
        return unit_vector(s, self.layer)
