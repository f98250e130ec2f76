"""Trajectories in a scenario file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot
from slidax.robots.joint_limits import JointLimits
from slidax.trajectories import AbstractTrajectory, MinimumJerk, Tabulated, Trapezoidal

from .base import AbstractDescription, FileName, Numbers, said
from .derived import union_of
from .limits import Limit, TrajectoryPart, limits_said
from .tool_path import ToolPathTrajectory


class WaypointTrajectory(TrajectoryPart):
    """A motion through waypoints."""

    waypoints: list[list[float]]

    def require_joints(self, joints: int) -> None:
        """Raises a DefinitionError unless each waypoint has one position per joint, before much is made of them.

        - `joints`: the number of joints.
        """
        for number, row in enumerate(self.waypoints):
            if len(row) != joints:
                message = f"must have one position for each of the {joints} joints; got {len(row)}"
                raise DefinitionError(message, where=f"waypoints.{number}")


class MinimumJerkTrajectory(WaypointTrajectory):
    """The smoothest motion through waypoints, at rest at both ends."""

    kind: Literal["minimum_jerk"]
    times: list[float] = said("when each waypoint is passed, increasing", "s")
    waypoints: list[list[float]] = said("one row of joint positions per time", "rad or m")

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """The trajectory; it has no use for `limits`."""
        return MinimumJerk.through(self.times, self.waypoints)


class LimitedTrajectory(WaypointTrajectory):
    """A motion through waypoints, as fast as limits allow."""

    waypoints: list[list[float]] = said("rows of joint positions, no two in a row the same", "rad or m")
    velocity: Limit = said("largest speed, or `robot`", "rad/s or m/s")
    acceleration: Numbers = said("largest acceleration", "rad/s² or m/s²")
    jerk: Numbers | None = said("largest jerk", "rad/s³ or m/s³", default=None, source="no limit")
    start: float = said("when it begins", "s", default=0.0)

    def _arguments(self, limits: JointLimits | None) -> dict[str, Any]:
        return self.parameters() | limits_said(self, limits, "velocity")


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

    file: FileName | None = None
    """Its path, from the folder of the scenario file."""
    text: str | None = None
    """What would be in the file, instead of it."""
    joints: list[str] | None = None
    """Names of the robot's joints in its order; the order of the file if not given."""
    start: float | None = said("when the first row is to be", "s", default=None, source="the file")
    lower: Limit | None = said("least positions, or `robot`", "rad or m", default=None, source="not checked")
    upper: Limit | None = said("largest positions, or `robot`", "rad or m", default=None, source="not checked")
    velocity: Limit | None = said("largest speed, or `robot`", "rad/s or m/s", default=None, source="not checked")
    acceleration: Numbers | None = said(
        "largest acceleration", "rad/s² or m/s²", default=None, source="docs/trajectories.md"
    )

    def _arguments(self, limits: JointLimits | None) -> dict[str, Any]:
        said = limits_said(self, limits, "lower", "upper", "velocity")
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


if TYPE_CHECKING:
    TrajectoryDescription = AbstractDescription
else:
    TrajectoryDescription = union_of(
        AbstractTrajectory,
        MinimumJerkTrajectory,
        QuinticTrajectory,
        TrapezoidalTrajectory,
        CsvTrajectory,
        JointTrajectory,
        ToolPathTrajectory,
    )


def trajectory_of(described: Any, limits: JointLimits | None, robot: AbstractRobot) -> AbstractTrajectory:
    """The trajectory that is described.

    - `described`: a member of `TrajectoryDescription`.
    - `limits`: those of the robot, for a field that says `robot`; None if it has none.
    - `robot`: the arm, as the law knows it.

    Raises DefinitionError if it makes no sense.
    """
    if isinstance(described, ToolPathTrajectory):
        return described.build(limits, robot)
    if isinstance(described, WaypointTrajectory):
        described.require_joints(robot.joints)
    found: AbstractTrajectory = described.build(*([limits] if isinstance(described, TrajectoryPart) else []))
    return found
