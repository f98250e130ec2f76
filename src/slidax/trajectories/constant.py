"""A fixed posture."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, require
from slidax._types import Scalar, Vector

from .trajectory import AbstractTrajectory


class Constant(AbstractTrajectory):
    """`q_d(t) = c`.

    - `value`: c, [n], rad or m.

    Raises DefinitionError if it is not finite.
    """

    value: Vector = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        require(self, "value", True, "must be finite")

    @property
    def until(self) -> float:
        """It stands still from the start on."""
        return 0.0

    def position(self, t: Scalar) -> Vector:
        """`c` at any time.

        - `t`: time [s].
        """
        return self.value + 0.0 * t * jnp.zeros_like(self.value)
