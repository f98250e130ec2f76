"""Base class of motions that are polynomials in time."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.parts import DefinitionError, Scalar, Vector, is_traced, parameter

from .extremes import Extremes, extremes
from .trajectory import AbstractTrajectory


class AbstractPiecewisePolynomial(AbstractTrajectory):
    """One polynomial in time per joint between two knots, and rest before the first knot and after the last.

    A knot belongs to the piece that begins there, the last knot to the rest after it: where the acceleration jumps, the
    reference has the value after the knot. Subclasses ensure that position and velocity do not jump.
    """

    times: Float[Array, " knots"] = parameter("knots, increasing", "s")
    coefficients: Float[Array, "powers pieces n"] = parameter(
        "of each piece in powers of `t - times[i]`, highest first"
    )

    def __check_init__(self) -> None:
        name = type(self).__name__
        knots, shape = np.shape(self.times), np.shape(self.coefficients)
        if len(knots) != 1 or len(shape) != 3 or knots[0] != shape[1] + 1:
            raise DefinitionError(
                f"`{name}.coefficients` must be [powers pieces joints] with one piece between any two knots; "
                f"got shape {list(shape)} for {list(knots)} knots"
            )
        if not is_traced(self.times) and not np.all(np.diff(self.times) > 0):
            raise DefinitionError(f"`{name}.times` must increase")

    @property
    def until(self) -> Scalar:
        """The last knot [s]."""
        return self.times[-1]

    def position(self, t: Scalar) -> Vector:
        first, last = self.times[0], self.times[-1]
        # Not `clip`: at a tie its derivative is one half, and so neither that of the motion nor that of the rest.
        t = jnp.where(t < first, first, jnp.where(t < last, t, last))
        pieces = self.coefficients.shape[1]
        piece = jnp.clip(jnp.searchsorted(self.times, t, side="right") - 1, 0, pieces - 1)
        coefficients = self.coefficients[:, piece]
        x = t - self.times[piece]
        value = coefficients[0]
        for coefficient in coefficients[1:]:
            value = value * x + coefficient
        return value

    def extremes(self, order: int) -> Extremes:
        """Return the exact extremes of a derivative of the position.

        - `order`: 0 for the position, 1 for the velocity, 2 for the acceleration, 3 for the jerk.
        """
        return extremes(np.asarray(self.times), np.asarray(self.coefficients), order)
