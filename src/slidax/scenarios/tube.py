"""The tolerance band that judges a run, in a scenario file."""

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
    """The tolerance band, if there is one.

    - `description`: of it.
    - `robot`: whose errors it is about.

    Raises DefinitionError, with the path of the field, if it is invalid or has other joints.
    """
    if description is None:
        return None
    with located("tolerance"):
        tolerance: PrescribedPerformance = description.build()
        require_joints(tolerance, robot.joints, type(robot).__name__)
    return tolerance
