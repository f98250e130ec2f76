"""Joint limits from a data sheet."""

from __future__ import annotations

from slidax._errors import require_shape
from slidax.parts import AbstractPart, Vector, parameter


class JointLimits(AbstractPart):
    """Limits of each joint; infinite where there is none or none is known."""

    lower: Vector = parameter("least positions", "rad or m", "[-inf, inf)")
    upper: Vector = parameter("largest positions", "rad or m", "(lower, inf]")
    velocity: Vector = parameter("largest speeds", "rad/s or m/s", "(0, inf]")
    torque: Vector = parameter("largest torques", "N m or N", "(0, inf]")
    torque_rate: Vector = parameter("fastest changes of torque", "N m/s or N/s", "(0, inf]")

    def __check_init__(self) -> None:
        require_shape(self, (self.lower.size,), "upper", "velocity", "torque", "torque_rate")
