"""The limits of a motion in a scenario file: numbers, or the robot's own."""

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
    """What the joints should do."""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory.

        - `limits`: those of the robot, for a field that says `robot`; None if it has none.

        Raises DefinitionError if it makes no sense.
        """
        raise NotImplementedError


def limits_said(described: TrajectoryPart, limits: JointLimits | None, *fields: str) -> dict[str, Any]:
    """The fields that say `robot`, with the robot's numbers.

    - `described`: whose fields they are.
    - `limits`: of the robot; None if it has none.
    - `fields`: their names.

    Raises DefinitionError if a field says `robot` and the robot has no limits.
    """
    said: dict[str, Any] = {}
    for field in fields:
        if getattr(described, field) == "robot":
            with located(field):
                if limits is None:
                    raise DefinitionError("says `robot`, but this robot has no limits of its own: give numbers")
                said[field] = np.asarray(getattr(limits, field))
    return said
