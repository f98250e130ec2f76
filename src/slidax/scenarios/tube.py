"""Tolerance band of a run in a scenario file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from slidax._errors import located, require_joints
from slidax.robots import AbstractRobot
from slidax.transformations import PrescribedPerformance

from .derived import PartDescription, plain_of

if TYPE_CHECKING:
    ToleranceDescription = PartDescription
else:
    ToleranceDescription = plain_of(
        PrescribedPerformance, "ToleranceDescription", doc="Bounds of the error, drawn as an envelope is."
    )


def tolerance_of(description: ToleranceDescription | None, robot: AbstractRobot) -> PrescribedPerformance | None:
    """Build the tolerance band for the errors of a robot, if there is one.

    Raises DefinitionError, with the path of the field, if it is invalid or does not fit the joints.
    """
    if description is None:
        return None
    with located("tolerance"):
        tolerance: PrescribedPerformance = description.build()
        require_joints(tolerance, robot.joints, type(robot).__name__)
    return tolerance
