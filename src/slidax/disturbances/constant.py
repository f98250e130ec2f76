"""A force that does not change."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import as_array, require
from slidax._types import Scalar, State, Vector

from .disturbance import AbstractDisturbance


class Constant(AbstractDisturbance):
    """`τ_d = c`.

    - `value`: c, [n], N m or N.

    Raises DefinitionError if it is not finite.
    """

    value: Vector = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        require(self, "value", True, "must be finite")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return self.value
