"""The reaching law with two powers, above and below one."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.numerics import power, sig, sig_and_slope, unit_vector
from slidax.parts import Matrix, PerJoint, Scalar, Vector, parameter

from .proximal_step import proximal_step
from .reaching import AbstractReaching

LEAST = 1e-30
"""Within so much of zero [rad/s or m/s] the power below one is a straight line, with a slope that is a number."""


class TwoPowerReaching(AbstractReaching):
    """`-K1 Sig^v1(s) - K2 Sig^v2(s) - u s/(‖s‖ + s0)`, with `v1 > 1 > v2`: fast from far, and finite in time when near.

    The reaching law of the scheme that the paper cites as [24]. Reconstructed from the parameters of its Table 2;
    confidence medium.
    """

    title = "The reaching law with two powers, above and below one."

    k1: PerJoint = parameter("diagonal of K1", "N m or N", "> 0", "so that K1 is diagonal positive definite ([24])")
    k2: PerJoint = parameter("diagonal of K2", "N m or N", "> 0", "so that K2 is diagonal positive definite ([24])")
    v1: Scalar = parameter("exponent far from the surface", "", "> 1", "([24])")
    v2: Scalar = parameter("exponent near the surface", "", "(0, 1)", "([24])")
    layer: Scalar = parameter(
        "s0, width of the boundary layer",
        "rad/s or m/s",
        ">= 0",
        "(s0, eq. 51; 0 gives the unit vector of eq. 44)",
        default=0.0,
    )

    def continuous_term(self, s: Vector) -> Vector:
        """`K1 Sig^v1(s) + K2 Sig^v2(s)`, [n], N m or N."""
        return self.k1 * sig(s, self.v1) + self.k2 * sig(s, self.v2)

    def switching_direction(self, s: Vector) -> Vector:
        """`s/(‖s‖ + s0)`, [n], and 0 at s = 0."""
        return unit_vector(s, self.layer)

    def continuous_term_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """`K1 Sig^v1(s) + K2 Sig^v2(s)` and its derivative, [n]; below 1e-30 the second power is a straight line."""
        far, far_slope = sig_and_slope(s, self.v1)
        ratio, near_slope = self._near(s)
        return self.k1 * far + self.k2 * s * ratio, self.k1 * far_slope + self.k2 * near_slope

    def moved(self, s: Vector, step: Vector) -> Vector:
        """The s after a step along the tangent of `sig^v2`, [n], with which Newton does not jump over zero."""
        ratio, slope = self._near(s)
        near = s * ratio + slope * step
        straight, _ = self._near(jnp.zeros_like(s))
        return jnp.where(jnp.abs(near) > LEAST * straight, sig(near, 1.0 / self.v2), near / straight)

    def _near(self, s: Vector) -> tuple[Vector, Vector]:
        """`|s|^(v2 - 1)` and the slope of `sig^v2`, which is infinite at 0 but for the straight line there."""
        ratio = power(jnp.maximum(jnp.abs(s), LEAST), self.v2 - 1.0)
        return ratio, jnp.where(jnp.abs(s) > LEAST, self.v2, 1.0) * ratio

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        return proximal_step(self, metric, s, u)
