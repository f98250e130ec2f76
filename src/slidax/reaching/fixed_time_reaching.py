"""The reaching law of the paper: a power and a unit vector, sharp or smoothed."""

from __future__ import annotations

import equinox as eqx
import numpy as np

from slidax._errors import DefinitionError, as_array, is_traced, known, require, require_shape
from slidax._types import Matrix, PerJoint, Scalar, Vector
from slidax.numerics import is_positive_definite, matvec, sig, sig_and_slope, unit_vector

from .proximal_step import proximal_step
from .reaching import AbstractReaching


class FixedTimeReaching(AbstractReaching):
    """`-K0 Sig^r(s) - u s/(‖s‖ + s0)`, eqs. (43), (51); with `s0 = 0` the unit vector (44), 0 at s = 0.

    - `gain`: K0, one number, a diagonal [n] or a matrix [n n], symmetric positive definite.
    - `exponent`: r, one number, > 1.
    - `layer`: s0, width of the boundary layer, rad/s or m/s, one number >= 0.

    Raises DefinitionError if one of them is out of its range.
    """

    gain: PerJoint = eqx.field(converter=as_array)
    exponent: Scalar = eqx.field(converter=as_array)
    layer: Scalar = eqx.field(converter=as_array, default=0.0)

    def __check_init__(self) -> None:
        require_shape(self, (), "exponent", "layer")
        rule = "must be symmetric positive definite (K0, eq. 43)"
        if self.gain.ndim < 2:
            require(self, "gain", known(self.gain) > 0, rule)
        elif not is_traced(self.gain):
            matrix = np.asarray(self.gain)
            if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not is_positive_definite(matrix):
                raise DefinitionError(f"`FixedTimeReaching.gain` {rule}; got {matrix.tolist()}")
        require(self, "exponent", known(self.exponent) > 1, "must be > 1 (r, eq. 43)")
        require(self, "layer", known(self.layer) >= 0, "must be >= 0 (s0, eq. 51; 0 gives the unit vector of eq. 44)")

    def power(self, s: Vector) -> Vector:
        """`K0 Sig^r(s)`, [n], N m or N.

        - `s`: sliding variable [n], rad/s or m/s.
        """
        powers = sig(s, self.exponent)
        return matvec(self.gain, powers) if self.gain.ndim == 2 else self.gain * powers

    def direction(self, s: Vector) -> Vector:
        """`s/(‖s‖ + s0)`, [n], and 0 at s = 0.

        - `s`: sliding variable [n], rad/s or m/s.
        """
        return unit_vector(s, self.layer)

    def power_and_slope(self, s: Vector) -> tuple[Vector, Vector]:
        """`K0 Sig^r(s)` and its derivative, [n], for a diagonal K0.

        - `s`: sliding variable [n], rad/s or m/s.
        """
        powers, slope = sig_and_slope(s, self.exponent)
        return self.gain * powers, self.gain * slope

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """The implicit step, [n], with a diagonal K0: a full one times Sig^r is not monotone, so it may have none.

        - `metric`: A = M0/H, symmetric positive definite [n n].
        - `s`: sliding variable [n], rad/s or m/s.
        - `u`: size of the robust torque, >= 0, N m.

        Raises DefinitionError if K0 is a matrix.
        """
        if self.gain.ndim == 2:
            raise DefinitionError(
                "`FixedTimeReaching.gain` must be one number or a diagonal [n] for an implicit step, since a full "
                f"matrix times Sig^r is not monotone (K0, eq. 43); got shape {list(self.gain.shape)}"
            )
        return proximal_step(self, metric, s, u)
