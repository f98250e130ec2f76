"""Trajectories in a scenario file."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from slidax._errors import DefinitionError, DefinitionWarning, counted, each_of, located
from slidax._names import matched, quoted
from slidax.robots import AbstractRobot
from slidax.robots.joint_limits import JointLimits
from slidax.trajectories import AbstractTrajectory, MinimumJerk, Tabulated, Trapezoidal
from slidax.trajectories.piecewise_polynomial import AbstractPiecewisePolynomial
from slidax.trajectories.tabulated import TimeUnit

from .base import AbstractDescription, FileName, Numbers, said
from .derived import union_of
from .limits import Limit, TrajectoryPart, robot_limits
from .tool_path import ToolPathTrajectory
from .yaml_text import read_yaml, text_of

LONGER = 100.0
"""Duration of a motion over that of the run above which its unit of time is probably wrong."""


class WaypointTrajectory(TrajectoryPart):
    """A motion through waypoints."""

    waypoints: list[list[float]]

    def require_joints(self, joints: int) -> None:
        """Raise DefinitionError unless each waypoint has one position per joint."""
        for number, row in enumerate(self.waypoints):
            if len(row) != joints:
                message = f"must have one position for {each_of(joints, 'joint')}; got {len(row)}"
                raise DefinitionError(message, where=f"waypoints.{number}")


class MinimumJerkTrajectory(WaypointTrajectory):
    """The smoothest motion through waypoints, at rest at both ends."""

    kind: Literal["minimum_jerk"]
    times: list[float] = said("when each waypoint is passed, increasing", "s")
    waypoints: list[list[float]] = said("one row of joint positions per time", "rad or m")

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        """Build the trajectory; `limits` is not used."""
        return MinimumJerk.through(self.times, self.waypoints)


class LimitedTrajectory(WaypointTrajectory):
    """A motion through waypoints, as fast as limits allow."""

    waypoints: list[list[float]] = said("rows of joint positions, no two in a row the same", "rad or m")
    velocity: Limit = said("largest speed, or `robot`", "rad/s or m/s")
    acceleration: Numbers = said("largest acceleration", "rad/s² or m/s²")
    jerk: Numbers | None = said("largest jerk", "rad/s³ or m/s³", default=None, source="no limit")
    start: float = said("when it begins", "s", default=0.0)

    def _arguments(self, limits: JointLimits | None) -> dict[str, Any]:
        return self.parameters() | robot_limits(self, limits, "velocity")


class QuinticTrajectory(LimitedTrajectory):
    """The smoothest motion through waypoints, without stopping, as fast as limits allow."""

    kind: Literal["quintic"]

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        return MinimumJerk.within(**self._arguments(limits))


class TrapezoidalTrajectory(LimitedTrajectory):
    """As fast as limits allow from waypoint to waypoint, at rest at each; an S-curve with a limit of jerk."""

    kind: Literal["trapezoidal"]

    def build(self, limits: JointLimits | None = None) -> AbstractTrajectory:
        return Trapezoidal.through(**self._arguments(limits))


class TableTrajectory(TrajectoryPart):
    """A motion from a file."""

    file: FileName | None = None
    """Its path, relative to the folder of the scenario file."""
    text: str | None = None
    """Content of such a file, in place of `file`."""
    joints: list[str] | None = None
    """The file's names of the robot's joints, in the robot's order; by default the robot's own names."""
    time_unit: TimeUnit | None = None
    """Unit of the times: s, ms, us or ns; by default the file's own, or s."""
    start: float | None = said("when the first row is to be", "s", default=None, source="the file")
    lower: Limit | None = said("least positions, or `robot`", "rad or m", default=None, source="not checked")
    upper: Limit | None = said("largest positions, or `robot`", "rad or m", default=None, source="not checked")
    velocity: Limit | None = said("largest speed, or `robot`", "rad/s or m/s", default=None, source="not checked")
    acceleration: Numbers | None = said(
        "largest acceleration", "rad/s² or m/s²", default=None, source="docs/trajectories.md"
    )

    def _arguments(self, limits: JointLimits | None, robot: AbstractRobot | None) -> dict[str, Any]:
        arguments = self.parameters() | robot_limits(self, limits, "lower", "upper", "velocity")
        if robot is not None:
            arguments["joints"] = self._names(robot.joint_names)
        return {name: value for name, value in arguments.items() if name not in ("file", "text")}

    def _names(self, own: Sequence[str]) -> Sequence[str]:
        """The file's names of the robot's joints, in the robot's order."""
        if self.joints is None:
            return own
        with located("joints"):
            if len(self.joints) != len(own):
                raise DefinitionError(
                    f"must have one name for each of the robot's {counted(len(own), 'joint')}, {quoted(own)}; got "
                    f"{len(self.joints)}"
                )
            for name, place in matched(self.joints, own).items():
                if own[place] != name:
                    raise DefinitionError(
                        f"`{name}` stands in the place of the robot's joint `{own[place]}`; the robot's order is "
                        f"{quoted(own)}. Leave `joints` out, and each column is found by its name"
                    )
        return self.joints

    def _source(self) -> str:
        """The path, or the text with a line break, by which the reader recognizes a text."""
        if self.text is None and self.file is not None:
            return self.file
        if self.file is None and self.text is not None:
            return self.text + "\n"
        raise DefinitionError("needs either `file` or `text`")


class CsvTrajectory(TableTrajectory):
    """A motion from a CSV file: a column `time`, and one per joint."""

    kind: Literal["csv"]

    def build(self, limits: JointLimits | None = None, robot: AbstractRobot | None = None) -> AbstractTrajectory:
        units = () if robot is None else robot.joint_units
        return Tabulated.from_csv(self._source(), units=units, **self._arguments(limits, robot))


class JointTrajectory(TableTrajectory):
    """A motion from a ROS message, trajectory_msgs/JointTrajectory, as JSON or, in a file, as YAML."""

    kind: Literal["joint_trajectory"]

    def build(self, limits: JointLimits | None = None, robot: AbstractRobot | None = None) -> AbstractTrajectory:
        if self.text is not None and not self.text.lstrip().startswith("{"):
            raise DefinitionError("must be a JSON object, in braces", where="text")
        source = self._source()
        message = _yaml_message(Path(source)) if self.text is None and source.endswith((".yaml", ".yml")) else source
        return Tabulated.from_joint_trajectory(message, **self._arguments(limits, robot))


def _yaml_message(path: Path) -> dict[str, Any]:
    """The message in a file from `ros2 topic echo`, which ends each message with a line of `---`."""
    name = f"`{path.name}`"
    text = text_of(path, "the file").removeprefix("\ufeff")
    parts = [part for part in re.split(r"^---\s*$", text, flags=re.M) if part.strip()]
    if len(parts) != 1:
        raise DefinitionError(f"{name} must have one message; got {len(parts)}")
    try:
        message = read_yaml(parts[0])
    except DefinitionError as error:
        raise DefinitionError(f"{name}: {error}") from None
    if not isinstance(message, dict):
        raise DefinitionError(f"{name} must be a mapping with `joint_names` and `points`")
    return message


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
    """Build the trajectory of a `TrajectoryDescription`.

    - `limits`: limits of the robot for fields with the value `robot`; None if it has none.
    - `robot`: the nominal arm.

    Raises DefinitionError if the description is invalid.
    """
    if isinstance(described, ToolPathTrajectory | CsvTrajectory | JointTrajectory):
        return described.build(limits, robot)
    if isinstance(described, WaypointTrajectory):
        described.require_joints(robot.joints)
    return described.build(*([limits] if isinstance(described, TrajectoryPart) else []))


def warn_of_units(described: Any, trajectory: AbstractTrajectory, t1: float) -> None:
    """Warn if a motion from a file is so much longer than the run that its times may not be in seconds.

    - `described`: a `TrajectoryDescription`; with a unit of time there is no warning.
    - `t1`: end of the run [s].
    """
    is_tool = isinstance(described, ToolPathTrajectory)
    if not (is_tool or isinstance(described, TableTrajectory)) or not (described.file or described.text):
        return
    if not is_tool and described.time_unit is not None:
        return
    assert isinstance(trajectory, AbstractPiecewisePolynomial)
    until = float(trajectory.until)
    if until < LONGER * t1:
        return
    likely = next((unit for unit, factor in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if until * factor < 10 * t1), "")
    remedy = "make `simulation.t1` longer" + ("" if is_tool else ", or set `trajectory.time_unit` to s")
    if likely and is_tool:
        remedy = f"are its times in {likely}? Then call their column `time [{likely}]`"
    elif likely:
        remedy = f"are its times in {likely}? Then set `trajectory.time_unit` to {likely}, otherwise to s"
    name = "the text" if described.file is None else f"`{Path(described.file).name}`"
    warnings.warn(
        DefinitionWarning(f"trajectory: {name} lasts {until:.4g} s, but the run ends at {t1:.4g} s: {remedy}"),
        stacklevel=2,
    )
