"""The reaching law of the paper: a power and a unit vector, discontinuous or smoothed."""

from __future__ import annotations

import numpy as np

from slidax.numerics import is_positive_definite, matvec, sig, sig_and_slope, unit_vector
from slidax.parts import DefinitionError, Matrix, PerJoint, Scalar, Vector, is_traced, known, parameter, require, shown

from .proximal_step import proximal_step
from .reaching import AbstractReaching


class FixedTimeReaching(AbstractReaching):
    """`-K0 Sig^r(s) - u s/(‖s‖ + s0)`, eqs. (43), (51); with `s0 = 0` the unit vector (44), 0 at s = 0."""

    title = "The reaching law of the paper: a power and a unit vector, discontinuous or smoothed."

    gain: PerJoint = parameter("K0, symmetric positive definite", "N m or N", matrix=True)
    exponent: Scalar = parameter("r, exponent of the power of s", "", "> 1", "(r, eq. 43)")
    layer: Scalar = parameter(
        "s0, width of the boundary layer",
        "rad/s or m/s",
        ">= 0",
        "(s0, eq. 51; 0 gives the unit vector of eq. 44)",
        default=0.0,
    )

    def __check_init__(self) -> None:
        rule = "must be symmetric positive definite (K0, eq. 43)"
        if self.gain.ndim < 2:
            require(self, "gain", known(self.gain) > 0, rule)
        elif not is_traced(self.gain):
            matrix = np.asarray(self.gain)
            if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not is_positive_definite(matrix):
                raise DefinitionError(f"`FixedTimeReaching.gain` {rule}; got {shown(matrix)}")

    def continuous_term(self, s: Vector) -> Vector:
        """`K0 Sig^r(s)`, [n], N m or N."""
        powers = sig(s, self.exponent)
        return matvec(self.gain, powers) if self.gain.ndim == 2 else self.gain * powers

    def switching_direction(self, s: Vector) -> Vector:
        """`s/(‖s‖ + s0)`, [n], and 0 at s = 0."""
        return unit_vector(s, self.layer)

    def continuous_term_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """`K0 Sig^r(s)` and its derivative, [n], for a diagonal K0."""
        powers, slope = sig_and_slope(s, self.exponent)
        return self.gain * powers, self.gain * slope

    def moved(self, s: Vector, step: Vector) -> Vector:
        """`s + step`, [n]: Newton's steps need no other coordinates for a power above one."""
        return s + step

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """The implicit step, [n], with a diagonal K0: a full one times Sig^r is not monotone, so it may have none.

        Raises DefinitionError if K0 is a matrix.
        """
        if self.gain.ndim == 2:
            raise DefinitionError(
                "`FixedTimeReaching.gain` must be one number or a diagonal [n] for an implicit step, since a full "
                f"matrix times Sig^r is not monotone (K0, eq. 43); got shape {list(self.gain.shape)}"
            )
        return proximal_step(self, metric, s, u)
