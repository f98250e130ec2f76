"""A force that sets in at a time, such as a payload's weight or a push."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, known, require
from slidax._types import Scalar, State, Vector

from .disturbance import AbstractDisturbance


class Step(AbstractDisturbance):
    """`τ_d = c` for `start <= t < end`, else 0.

    - `value`: c, [n], N m or N.
    - `start`: s.
    - `end`: s, after `start`; infinite if not given.

    Raises DefinitionError if the value is not finite or the end is not after the start.
    """

    value: Vector = eqx.field(converter=as_array)
    start: Scalar = eqx.field(converter=as_array)
    end: Scalar = eqx.field(converter=as_array, default=float("inf"))

    def __check_init__(self) -> None:
        require(self, "value", True, "must be finite")
        require(self, "start", known(self.end) > known(self.start), f"must be before its end ({self.end} s)")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c` while it lasts, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return jnp.where((t >= self.start) & (t < self.end), self.value, 0.0)
