"""Trajectories in a scenario file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, located
from slidax.robots.joint_limits import JointLimits
from slidax.trajectories import (
    AbstractTrajectory,
    Constant,
    ExponentialSum,
    MinimumJerk,
    Sinusoid,
    Tabulated,
    Trapezoidal,
)

from .base import Description, Numbers

Limit = Annotated[float | list[float] | Literal["robot"], Field(union_mode="left_to_right")]
"""One number for all joints, one per joint, or `robot` for the robot's own limits."""


class TrajectoryPart(Description):
    """What the joints should do."""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory.

        - `limits`: those of the robot, for a field that says `robot`; None if it has none.

        Raises DefinitionError if it makes no sense.
        """
        raise NotImplementedError


class ConstantTrajectory(TrajectoryPart):
    """A fixed posture."""

    kind: Literal["constant"]
    value: list[float]
    """The posture, one entry per joint [rad or m]."""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory; it has no use for `limits`."""
        return Constant(**self.parameters())


class SinusoidTrajectory(TrajectoryPart):
    """offset + amplitude sin(frequency t + phase), per joint."""

    kind: Literal["sinusoid"]
    offset: list[float]
    """One entry per joint [rad or m]."""
    amplitude: Numbers
    """[rad or m]"""
    frequency: Numbers
    """[rad/s]"""
    phase: Numbers = 0.0
    """[rad]"""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory; it has no use for `limits`."""
        return Sinusoid(**self.parameters())


class ExponentialSumTrajectory(TrajectoryPart):
    """offset + sum of amplitudes exp(-rate t): a smooth move that comes to rest."""

    kind: Literal["exponential_sum"]
    offset: list[float]
    """Where it comes to rest, one entry per joint [rad or m]."""
    amplitudes: list[list[float]]
    """One row per rate, one column per joint [rad or m]."""
    rates: list[float]
    """[1/s], positive."""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory; it has no use for `limits`."""
        return ExponentialSum(**self.parameters())


class MinimumJerkTrajectory(TrajectoryPart):
    """The smoothest motion through waypoints, at rest at both ends."""

    kind: Literal["minimum_jerk"]
    times: list[float]
    """When each waypoint is passed [s], increasing."""
    waypoints: list[list[float]]
    """One row of joint positions per time [rad or m]."""

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory; it has no use for `limits`."""
        return MinimumJerk.through(self.times, self.waypoints)


class LimitedTrajectory(TrajectoryPart):
    """A motion through waypoints, as fast as limits allow."""

    waypoints: list[list[float]]
    """Rows of joint positions [rad or m], no two in a row the same."""
    velocity: Limit
    """Largest speed, or `robot` [rad/s or m/s]."""
    acceleration: Numbers
    """Largest acceleration [rad/s² or m/s²]."""
    jerk: Numbers | None = None
    """Largest jerk [rad/s³ or m/s³]; no limit if not given."""
    start: float = 0.0
    """When it begins [s]."""

    def _arguments(self, limits: JointLimits | None) -> dict[str, Any]:
        return self.parameters() | _said(self, limits, "velocity")


class QuinticTrajectory(LimitedTrajectory):
    """The smoothest motion through waypoints, without stopping, as fast as limits allow."""

    kind: Literal["quintic"]

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory, with `limits` for the word `robot`."""
        return MinimumJerk.within(**self._arguments(limits))


class TrapezoidalTrajectory(LimitedTrajectory):
    """As fast as limits allow from waypoint to waypoint, at rest at each; an S-curve with a limit of jerk."""

    kind: Literal["trapezoidal"]

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory, with `limits` for the word `robot`."""
        return Trapezoidal.through(**self._arguments(limits))


class TableTrajectory(TrajectoryPart):
    """A motion from a file."""

    file: str | None = None
    """Its path, from the current directory."""
    text: str | None = None
    """What would be in the file, instead of it."""
    joints: list[str] | None = None
    """Names of the robot's joints in its order; the order of the file if not given."""
    start: float | None = None
    """When the first row is to be [s]; as in the file if not given."""
    lower: Limit | None = None
    """Least positions, or `robot` [rad or m]; not checked if not given."""
    upper: Limit | None = None
    """Largest positions, or `robot` [rad or m]; not checked if not given."""
    velocity: Limit | None = None
    """Largest speed, or `robot` [rad/s or m/s]; not checked if not given."""
    acceleration: Numbers | None = None
    """Largest acceleration [rad/s² or m/s²]; see docs/trajectories.md if not given."""

    def _arguments(self, limits: JointLimits | None) -> dict[str, Any]:
        said = _said(self, limits, "lower", "upper", "velocity")
        return {name: value for name, value in (self.parameters() | said).items() if name not in ("file", "text")}

    def _source(self) -> str:
        """The path, or the text with a line break, which says that it is the text."""
        if self.text is None and self.file is not None:
            return self.file
        if self.file is None and self.text is not None:
            return self.text + "\n"
        raise DefinitionError("needs either `file` or `text`")


class CsvTrajectory(TableTrajectory):
    """A motion from a CSV file: a column `time`, and one per joint."""

    kind: Literal["csv"]

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory, with `limits` for the word `robot`."""
        return Tabulated.from_csv(self._source(), **self._arguments(limits))


class JointTrajectory(TableTrajectory):
    """A motion from a ROS message, trajectory_msgs/JointTrajectory, as JSON."""

    kind: Literal["joint_trajectory"]

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory, with `limits` for the word `robot`."""
        if self.text is not None and not self.text.lstrip().startswith("{"):
            raise DefinitionError("must be a JSON object, in braces", where="text")
        return Tabulated.from_joint_trajectory(self._source(), **self._arguments(limits))


def _said(described: TrajectoryPart, limits: JointLimits | None, *fields: str) -> dict[str, Any]:
    """The fields that say `robot`, with the robot's numbers."""
    said: dict[str, Any] = {}
    for field in fields:
        if getattr(described, field) == "robot":
            with located(field):
                if limits is None:
                    raise DefinitionError("says `robot`, but this robot has no limits of its own: give numbers")
                said[field] = np.asarray(getattr(limits, field))
    return said


TrajectoryDescription = Annotated[
    ConstantTrajectory
    | SinusoidTrajectory
    | ExponentialSumTrajectory
    | MinimumJerkTrajectory
    | QuinticTrajectory
    | TrapezoidalTrajectory
    | CsvTrajectory
    | JointTrajectory,
    Field(discriminator="kind"),
]
