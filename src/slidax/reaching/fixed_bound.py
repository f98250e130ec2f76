"""A robust torque whose size does not depend on the state."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import as_array, known, require, require_shape
from slidax._types import Scalar, State, Vector


class FixedBound(eqx.Module):
    """`u = const`: for laws that choose the size of their robust torque by hand.

    - `size`: u, N m, >= 0.

    Raises DefinitionError if it is negative.
    """

    size: Scalar = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        require_shape(self, (), "size")
        require(self, "size", known(self.size) >= 0, "must be >= 0 N m (u)")

    def __call__(self, state: State, tau: Vector) -> Scalar:
        """u, N m.

        - `state`, `tau`: not used.
        """
        return self.size
