"""The reaching law with two powers, one for each side of one."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, known, require, require_consistent, require_shape
from slidax._types import Matrix, PerJoint, Scalar, Vector
from slidax.numerics import power, sig, sig_and_slope, unit_vector

from .proximal_step import proximal_step
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

    k1: PerJoint = eqx.field(converter=as_array)
    k2: PerJoint = eqx.field(converter=as_array)
    v1: Scalar = eqx.field(converter=as_array)
    v2: Scalar = eqx.field(converter=as_array)
    layer: Scalar = eqx.field(converter=as_array, default=0.0)

    def __check_init__(self) -> None:
        require_consistent(self, "k1", "k2")
        require_shape(self, (), "v1", "v2", "layer")
        require(self, "k1", known(self.k1) > 0, "must be > 0, so that K1 is diagonal positive definite ([24])")
        require(self, "k2", known(self.k2) > 0, "must be > 0, so that K2 is diagonal positive definite ([24])")
        require(self, "v1", known(self.v1) > 1, "must be > 1 ([24])")
        require(self, "v2", (known(self.v2) > 0) & (known(self.v2) < 1), "must be in (0, 1) ([24])")
        require(self, "layer", known(self.layer) >= 0, "must be >= 0 (s0, eq. 51; 0 gives the unit vector of eq. 44)")

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

    def power_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """`K1 Sig^v1(s) + K2 Sig^v2(s)` and its derivative, [n]; below 1e-30 the slope stays as it is there.

        - `s`: sliding variable [n], rad/s or m/s.
        """
        far, far_slope = sig_and_slope(s, self.v1)
        # The slope of sig^v2 is infinite at 0; held finite, it stays larger than any other there.
        ratio = power(jnp.maximum(jnp.abs(s), 1e-30), self.v2 - 1.0)
        return self.k1 * far + self.k2 * s * ratio, self.k1 * far_slope + self.k2 * self.v2 * ratio

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """The implicit step, [n].

        - `metric`: A = M0/H, symmetric positive definite [n n].
        - `s`: sliding variable [n], rad/s or m/s.
        - `u`: size of the robust torque, >= 0, N m.
        """
        return proximal_step(self, metric, s, u)
