"""Limits of a motion in a scenario file: numbers, or the robot's own."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, located
from slidax.robots.joint_limits import JointLimits
from slidax.trajectories import AbstractTrajectory

from .base import AbstractDescription

Limit = Annotated[float | list[float] | Literal["robot"], Field(union_mode="left_to_right")]
"""One number for all joints, one per joint, or `robot` for the robot's own limits."""


class TrajectoryPart(AbstractDescription):
    """Desired motion of the joints."""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """Build the trajectory.

        - `limits`: limits of the robot for fields with the value `robot`; None if it has none.

        Raises DefinitionError if the description is invalid.
        """
        raise NotImplementedError


def robot_limits(described: TrajectoryPart, limits: JointLimits | None, *fields: str) -> dict[str, Any]:
    """Return the robot's numbers for each of the fields with the value `robot`.

    Raises DefinitionError if the robot has no limits.
    """
    numbers: dict[str, Any] = {}
    for field in fields:
        if getattr(described, field) == "robot":
            with located(field):
                if limits is None:
                    raise DefinitionError("says `robot`, but this robot has no limits of its own: give numbers")
                numbers[field] = np.asarray(getattr(limits, field))
    return numbers
