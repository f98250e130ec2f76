"""What the joints of an arm can do, by its data sheet."""

from __future__ import annotations

import equinox as eqx
import numpy as np

from slidax._errors import DefinitionError, as_array, is_traced, known
from slidax._types import Vector


class JointLimits(eqx.Module):
    """The range of each joint; infinite where there is no limit, or where none is known.

    - `lower`, `upper`: positions [n], rad or m.
    - `velocity`: largest speed [n], rad/s or m/s, > 0.
    - `torque`: largest torque [n], N m or N, > 0.
    - `torque_rate`: fastest change of torque [n], N m/s or N/s, > 0.

    Raises DefinitionError if one of them is out of its range or they are not equally long.
    """

    lower: Vector = eqx.field(converter=as_array)
    upper: Vector = eqx.field(converter=as_array)
    velocity: Vector = eqx.field(converter=as_array)
    torque: Vector = eqx.field(converter=as_array)
    torque_rate: Vector = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        shape = np.shape(self.lower)
        for field in ("lower", "upper", "velocity", "torque", "torque_rate"):
            value = getattr(self, field)
            if len(shape) != 1 or np.shape(value) != shape:
                raise DefinitionError(
                    f"`JointLimits.{field}` must have one entry per joint, as `lower` with shape {list(shape)}; "
                    f"got shape {list(np.shape(value))}"
                )
        if is_traced(self):
            return
        self._require("upper", known(self.upper) > known(self.lower), "must be > `lower`")
        for field in ("velocity", "torque", "torque_rate"):
            self._require(field, known(getattr(self, field)) > 0, "must be > 0 (infinite for no limit)")

    def _require(self, field: str, holds: np.ndarray, rule: str) -> None:
        """Not `require`, which refuses the infinite."""
        if not holds.all():
            joint = int(np.argmin(holds))
            value = known(getattr(self, field))[joint].item()
            raise DefinitionError(f"`JointLimits.{field}` {rule}; got {value:g} for joint {joint + 1}")
