"""Trajectories and tool paths in a scenario file."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax.arms.arm import AbstractRobot, JointLimits
from slidax.arms.chain import Pose
from slidax.core.errors import DefinitionError, DefinitionWarning, as_array, count_noun, each_of, locate_errors
from slidax.core.files import read_text
from slidax.core.joint_names import match_names, quote_names
from slidax.motions.follow import follow
from slidax.motions.moves import AbstractMove, Circle, Line, Pause, Screw, Through
from slidax.motions.stream import Streamed, StreamFilter, jerk_of_drives
from slidax.motions.table_files import csv_lines, csv_table, unit_of
from slidax.motions.tabulated import Tabulated, TimeUnit
from slidax.motions.trajectory import AbstractMotion, AbstractPiecewisePolynomial
from slidax.motions.waypoints import MinimumJerk, Trapezoidal

from .descriptions import AbstractDescription, FileName, Numbers, input_field, same_field, union_of
from .yaml_text import read_yaml

Limit = Annotated[float | list[float] | Literal["robot"], Field(union_mode="left_to_right")]
"""One number for all joints, one per joint, or `robot` for the robot's own limits."""


class TrajectoryPart(AbstractDescription):
    """Desired motion of the joints."""

    may_be_infinite = frozenset({"lower", "upper", "velocity", "acceleration", "jerk"})

    def build(self, limits: JointLimits | None = None) -> AbstractMotion:
        """Build the trajectory.

        - `limits`: limits of the robot, for fields with the value `robot`; None if it has none.

        Raises DefinitionError if the description is invalid.
        """
        raise NotImplementedError


def robot_limits(described: TrajectoryPart, limits: JointLimits | None, *fields: str) -> dict[str, Any]:
    """Return the robot's limits by field, for those fields whose value is `robot`.

    - `described`: description of the trajectory.
    - `limits`: limits of the robot; None if it has none.
    - `fields`: names of the fields to check, which are also names of limits.

    Raises DefinitionError if the robot has no limits.
    """
    numbers: dict[str, Any] = {}
    for field in fields:
        if getattr(described, field) == "robot":
            with locate_errors(field):
                if limits is None:
                    raise DefinitionError("is `robot`, but this robot has no limits: write numbers")
                numbers[field] = np.asarray(getattr(limits, field))
    return numbers


Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]
Seven = Annotated[list[float], Field(min_length=7, max_length=7)]


class MoveDescription(AbstractDescription):
    """A move of the tool from rest to rest, starting at the end of the previous move."""

    move: ClassVar[type[AbstractMove]]
    duration: float | None = input_field(
        "duration of the move", "s", "> 0", default=None, source="`speed`, or the shortest that the joints allow"
    )
    speed: float | None = input_field("largest speed of the tip", "m/s", "> 0", default=None, source="no limit")
    acceleration: float | None = input_field(
        "largest acceleration of the tip", "m/s²", "> 0", default=None, source="no limit"
    )

    def build(self) -> AbstractMove:
        """Build the move."""
        return self.move(**self.parameters())


class LineDescription(MoveDescription):
    """A straight line of the tip, with a rotation of the tool about a fixed axis."""

    move = Line
    kind: Literal["line"]
    to: Three | None = input_field("end position of the tip, in the base frame", "m", default=None, source="`by`")
    by: Three | None = input_field("displacement of the tip, in the base frame", "m", default=None, source="`to`")
    quaternion: Four | None = input_field(
        "orientation of the tool at the end, w, x, y, z", "", default=None, source="as at the start"
    )


class CircleDescription(MoveDescription):
    """An arc of the tip about an axis."""

    move = Circle
    kind: Literal["circle"]
    center: Three = input_field("a point on the axis, in the base frame", "m")
    axis: Three = input_field("direction of the axis, of any length")
    angle: float = input_field("angle of the arc", "rad", default=2 * np.pi)
    tool: Literal["fixed", "turns"] = "fixed"
    """`fixed` keeps the orientation of the tool; `turns` rotates it with the arc."""


class ScrewDescription(MoveDescription):
    """A screw motion: the tool rotates about an axis and moves along it."""

    move = Screw
    kind: Literal["screw"]
    axis: Three = input_field("direction of the axis, of any length")
    angle: float = input_field("rotation angle of the tool", "rad")
    pitch: float = input_field("displacement along the axis per revolution", "m", default=0.0)
    center: Three | None = input_field("a point on the axis, in the base frame", "m", default=None, source="the tip")


class ThroughDescription(MoveDescription):
    """A smooth curve through poses, without a stop."""

    move = Through
    kind: Literal["through"]
    poses: list[list[float]] = input_field("rows of x, y, z, or of x, y, z, qw, qx, qy, qz", "m")
    times: list[float] | None = input_field(
        "time of each pose; the first is the beginning of the move",
        "s",
        default=None,
        source="`duration`, or the joint limits",
    )


class PauseDescription(MoveDescription):
    """The tool stands still."""

    move = Pause
    kind: Literal["pause"]


AnyMove = Annotated[
    LineDescription | CircleDescription | ScrewDescription | ThroughDescription | PauseDescription,
    Field(discriminator="kind"),
]


class ToolPathTrajectory(TrajectoryPart):
    """A path of the tool, which the nominal arm's inverse kinematics turns into a joint trajectory."""

    kind: Literal["tool_path"]
    start: list[float] = input_field("posture in which the tool starts, one position per joint", "rad or m")
    pose: Seven | None = input_field(
        "pose at the beginning of the path, x, y, z, qw, qx, qy, qz; the inverse kinematics starts from `start`",
        "m",
        default=None,
        source="pose of the tool at `start`",
    )
    moves: list[AnyMove] = Field(default=[])
    """Moves of the tool, each from the end of the previous one."""
    file: FileName | None = None
    """A CSV file with columns time, x, y, z and optionally qw, qx, qy, qz, instead of `moves`; its path is relative to
    the folder of the scenario file."""
    text: str | None = None
    """Content of such a file, instead of `file`."""
    hold: Literal["place", "axis", "pose"] = "pose"
    """`place` prescribes the tip's position, `axis` also the tool's z axis, `pose` also its whole orientation."""
    posture: list[float] | None = input_field(
        "preferred posture of a redundant arm", "rad or m", default=None, source="its posture at the start"
    )
    velocity: Limit | None = input_field(
        "velocity limit of the joints, or `robot`", "rad/s or m/s", default=None, source="no limit"
    )
    acceleration: Numbers | None = input_field("acceleration limit", "rad/s² or m/s²", default=None, source="no limit")
    damping: float = input_field(
        "damping of the inverse kinematics, which allows a pose error near a singularity",
        "m or rad",
        "[0, 1]",
        default=0.0,
    )
    tolerance: float = input_field("largest error of the tool between knots", "m and rad", "[1e-9, 1e-2]", default=1e-6)
    begin: float = input_field("time at which the path begins", "s", ">= 0", default=0.0)

    def build(self, limits: JointLimits | None = None, robot: AbstractRobot | None = None) -> AbstractMotion:
        """Build the joint trajectory by which the nominal arm `robot` follows the path.

        - `limits`: limits of the robot, for `velocity: robot`; None if it has none.
        """
        assert robot is not None
        pose = None
        if self.pose is not None:
            with locate_errors("pose"):
                pose = Pose.of(self.pose[:3], self.pose[3:])
        named = ("hold", "start", "posture", "velocity", "acceleration", "damping", "tolerance", "begin")
        arguments: dict[str, Any] = {name: value for name, value in self.parameters().items() if name in named}
        arguments |= robot_limits(self, limits, "velocity")
        return follow(robot, self._moves(), pose=pose, **arguments).trajectory

    def _moves(self) -> list[AbstractMove]:
        sources = [name for name in ("moves", "file", "text") if getattr(self, name)]
        if len(sources) != 1:
            raise DefinitionError("needs exactly one of `moves`, `file` and `text`")
        if self.moves:
            return [move.build() for move in self.moves]
        with locate_errors(sources[0]):
            return [Through.from_csv(self.file if self.file is not None else f"{self.text}\n")]


LONGER = 100.0
"""Ratio of a motion's duration to the run's duration, above which the motion's time unit is probably wrong."""


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
    """The minimum-jerk motion through waypoints, at rest at both ends."""

    kind: Literal["minimum_jerk"]
    times: list[float] = input_field("time of each waypoint, increasing", "s")
    waypoints: list[list[float]] = input_field("one row of joint positions per time", "rad or m")

    def build(self, limits: JointLimits | None = None) -> AbstractMotion:
        """Build the trajectory; `limits` is not used."""
        return MinimumJerk.through(self.times, self.waypoints)


class LimitedTrajectory(WaypointTrajectory):
    """A motion through waypoints, as fast as limits allow."""

    waypoints: list[list[float]] = input_field("rows of joint positions; consecutive rows must differ", "rad or m")
    velocity: Limit = input_field("velocity limit, or `robot`", "rad/s or m/s")
    acceleration: Numbers = input_field("acceleration limit", "rad/s² or m/s²")
    jerk: Numbers | None = input_field("jerk limit", "rad/s³ or m/s³", default=None, source="no limit")
    start: float = input_field("time at which the motion begins", "s", default=0.0)

    def _arguments(self, limits: JointLimits | None) -> dict[str, Any]:
        return self.parameters() | robot_limits(self, limits, "velocity")


class QuinticTrajectory(LimitedTrajectory):
    """The minimum-jerk motion through waypoints, without stops between them, as fast as limits allow."""

    kind: Literal["quintic"]

    def build(self, limits: JointLimits | None = None) -> AbstractMotion:
        return MinimumJerk.within(**self._arguments(limits))


class TrapezoidalTrajectory(LimitedTrajectory):
    """The fastest motion from waypoint to waypoint, with a stop at each; with a jerk limit it is an S-curve."""

    kind: Literal["trapezoidal"]

    def build(self, limits: JointLimits | None = None) -> AbstractMotion:
        return Trapezoidal.through(**self._arguments(limits))


class TableTrajectory(TrajectoryPart):
    """A motion from a file."""

    file: FileName | None = None
    """Path of the file, relative to the folder of the scenario file."""
    text: str | None = None
    """Content of such a file, instead of `file`."""
    joints: list[str] | None = None
    """Names of the robot's joints in the file, in the robot's order; by default the robot's own names."""
    time_unit: TimeUnit | None = None
    """Unit of the times: s, ms, us or ns; by default the unit in the file, or s."""
    start: float | None = input_field("time of the first row", "s", default=None, source="the file")
    lower: Limit | None = input_field(
        "lower position limits, or `robot`", "rad or m", default=None, source="not checked"
    )
    upper: Limit | None = input_field(
        "upper position limits, or `robot`", "rad or m", default=None, source="not checked"
    )
    velocity: Limit | None = input_field(
        "velocity limits, or `robot`", "rad/s or m/s", default=None, source="not checked"
    )
    acceleration: Numbers | None = input_field(
        "acceleration limits", "rad/s² or m/s²", default=None, source="docs/trajectories.md"
    )

    def _arguments(self, limits: JointLimits | None, robot: AbstractRobot | None) -> dict[str, Any]:
        arguments = self.parameters() | robot_limits(self, limits, "lower", "upper", "velocity")
        if robot is not None:
            arguments["joints"] = self._names(robot.joint_names)
        return {name: value for name, value in arguments.items() if name not in ("file", "text")}

    def _names(self, own: Sequence[str]) -> Sequence[str]:
        """Names of the robot's joints in the file, in the robot's order."""
        if self.joints is None:
            return own
        with locate_errors("joints"):
            if len(self.joints) != len(own):
                raise DefinitionError(
                    f"must have one name for each of the robot's {count_noun(len(own), 'joint')}, {quote_names(own)}; "
                    f"got {len(self.joints)}"
                )
            for name, index in match_names(self.joints, own).items():
                if own[index] != name:
                    raise DefinitionError(
                        f"`{name}` is at the position of the robot's joint `{own[index]}`; the robot's order is "
                        f"{quote_names(own)}. Leave `joints` out to match columns by name"
                    )
        return self.joints

    def _source(self) -> str:
        """The path, or the text with a line break, by which the reader tells a text from a path."""
        if self.text is None and self.file is not None:
            return self.file
        if self.file is None and self.text is not None:
            return self.text + "\n"
        raise DefinitionError("needs either `file` or `text`")


class CsvTrajectory(TableTrajectory):
    """A motion from a CSV file with a column `time` and a column per joint."""

    kind: Literal["csv"]

    def build(self, limits: JointLimits | None = None, robot: AbstractRobot | None = None) -> AbstractMotion:
        units = () if robot is None else robot.joint_units
        return Tabulated.from_csv(self._source(), units=units, **self._arguments(limits, robot))


class StreamedTrajectory(TableTrajectory):
    """Positions that a host streams at its own rate; a filter computes the reference and its derivatives."""

    kind: Literal["streamed"]
    bandwidth: Numbers = same_field(StreamFilter, "bandwidth")
    velocity: Limit = input_field("velocity limit, or `robot`", "rad/s or m/s")
    acceleration: Numbers = same_field(StreamFilter, "acceleration")
    jerk: Numbers | None = same_field(
        StreamFilter, "jerk", default=None, source="half of the drives' torque rate, or a limit that does not act"
    )
    rate: float | None = input_field(
        "positions per second; the goal moves linearly from one to the next",
        "Hz",
        "> 0",
        default=None,
        source="each position is held",
    )
    lower: Limit | None = input_field("lower position limits", "rad or m", default=None, source="the robot's")
    upper: Limit | None = input_field("upper position limits", "rad or m", default=None, source="the robot's")

    def build(
        self,
        limits: JointLimits | None = None,
        robot: AbstractRobot | None = None,
        period: float = 1e-3,
        torque_rate: Any = np.inf,
    ) -> AbstractMotion:
        """Build the motion.

        - `limits`: limits of the robot, defaults of `lower` and `upper`; None if it has none.
        - `robot`: the nominal arm.
        - `period`: sample time of the law [s].
        - `torque_rate`: fastest change of the drives' torque, N m/s or N/s.
        """
        assert robot is not None
        table = csv_table(self._source(), self._names(robot.joint_names), self.time_unit, robot.joint_units)
        table = table.shifted(self.start)
        values = self.parameters() | robot_limits(self, limits, "lower", "upper", "velocity")
        if limits is not None:
            values = {"lower": np.asarray(limits.lower), "upper": np.asarray(limits.upper)} | values
        outside = ("file", "text", "joints", "time_unit", "start")
        options = {name: value for name, value in values.items() if name not in outside}
        if self.jerk is None and np.isfinite(torque_rate).any():
            mass = np.asarray(robot.mass(as_array(table.positions[0])))
            options["jerk"] = jerk_of_drives(mass, torque_rate, self.bandwidth, self.acceleration, period)
        return Streamed.through(table.times, table.positions, StreamFilter.fitting(period=period, **options))


class JointTrajectory(TableTrajectory):
    """A motion from a ROS message, trajectory_msgs/JointTrajectory, as JSON or, in a file, as YAML."""

    kind: Literal["joint_trajectory"]

    def build(self, limits: JointLimits | None = None, robot: AbstractRobot | None = None) -> AbstractMotion:
        if self.text is not None and not self.text.lstrip().startswith("{"):
            raise DefinitionError("must be a JSON object, in braces", where="text")
        source = self._source()
        message = _yaml_message(Path(source)) if self.text is None and source.endswith((".yaml", ".yml")) else source
        return Tabulated.from_joint_trajectory(message, **self._arguments(limits, robot))


def _yaml_message(path: Path) -> dict[str, Any]:
    """The message in a file from `ros2 topic echo`, which ends each message with a line of `---`."""
    name = f"`{path.name}`"
    text = read_text(path, "the file").removeprefix("\ufeff")
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
        AbstractMotion,
        MinimumJerkTrajectory,
        QuinticTrajectory,
        TrapezoidalTrajectory,
        CsvTrajectory,
        JointTrajectory,
        StreamedTrajectory,
        ToolPathTrajectory,
    )


def trajectory_of(
    described: Any, limits: JointLimits | None, robot: AbstractRobot, period: float, torque_rate: Any
) -> AbstractMotion:
    """Build the trajectory of a scenario.

    - `described`: its description, a `TrajectoryDescription`.
    - `limits`: limits of the robot, for fields with the value `robot`; None if it has none.
    - `robot`: the nominal arm.
    - `period`: sample time of the law [s].
    - `torque_rate`: fastest change of the drives' torque, N m/s or N/s.

    Raises DefinitionError if the description is invalid.
    """
    if isinstance(described, StreamedTrajectory):
        return described.build(limits, robot, period, torque_rate)
    if isinstance(described, ToolPathTrajectory | CsvTrajectory | JointTrajectory):
        return described.build(limits, robot)
    if isinstance(described, WaypointTrajectory):
        described.require_joints(robot.joints)
    return described.build(*([limits] if isinstance(described, TrajectoryPart) else []))


def motion_of_file(path: str | Path, robot: AbstractRobot, start: Sequence[float]) -> AbstractMotion:
    """Read a motion from a CSV file of joint positions or tool poses, or from a JointTrajectory as JSON or YAML.

    - `robot`: the nominal arm.
    - `start`: posture in which a tool path starts [n], rad or m.

    Raises DefinitionError, with the file and the line, if the file cannot be read, or the arm cannot follow the motion.
    """
    name = str(path)
    if name.endswith((".json", ".yaml", ".yml")):
        return JointTrajectory(kind="joint_trajectory", file=name).build(None, robot)
    titles = {unit_of(title)[0].casefold() for title in csv_lines(path, "time,joint")[1].titles}
    if {"x", "y", "z"} <= titles:
        hold: Literal["place", "pose"] = "pose" if "qw" in titles else "place"
        return ToolPathTrajectory(kind="tool_path", file=name, start=list(start), hold=hold).build(None, robot)
    return CsvTrajectory(kind="csv", file=name).build(None, robot)


def warn_of_units(described: Any, trajectory: AbstractMotion, t1: float) -> None:
    """Warn if a motion from a file is so much longer than the run that its times may not be in seconds.

    - `described`: the trajectory's description; a unit of time in it suppresses the warning.
    - `trajectory`: the motion that is built from it.
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
