"""Paths of a tool in a scenario file."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, located
from slidax.kinematics import AbstractMove, Circle, Line, Pause, Pose, Screw, Through, follow
from slidax.robots import AbstractRobot
from slidax.robots.joint_limits import JointLimits
from slidax.trajectories import AbstractTrajectory

from .base import AbstractDescription, FileName, Numbers, said
from .limits import Limit, TrajectoryPart, robot_limits

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]
Seven = Annotated[list[float], Field(min_length=7, max_length=7)]


class MoveDescription(AbstractDescription):
    """A move of the tool from rest to rest, starting at the end of the move before it."""

    move: ClassVar[type[AbstractMove]]
    duration: float | None = said(
        "how long it takes", "s", "> 0", default=None, source="`speed`, or the shortest that the joints allow"
    )
    speed: float | None = said("largest speed of the tip", "m/s", "> 0", default=None, source="no limit")
    acceleration: float | None = said("largest acceleration of the tip", "m/s²", "> 0", default=None, source="no limit")

    def build(self) -> AbstractMove:
        """Build the move."""
        return self.move(**self.parameters())


class LineDescription(MoveDescription):
    """A straight line of the tip, while the tool turns evenly about one axis."""

    move = Line
    kind: Literal["line"]
    to: Three | None = said("where the tip goes, in the base frame", "m", default=None, source="`by`")
    by: Three | None = said("how far it goes, in the base frame", "m", default=None, source="`to`")
    quaternion: Four | None = said(
        "how the tool is turned at the end, w, x, y, z", "", default=None, source="as at the start"
    )


class CircleDescription(MoveDescription):
    """An arc of the tip about an axis."""

    move = Circle
    kind: Literal["circle"]
    center: Three = said("a point of the axis, in the base frame", "m")
    axis: Three = said("direction of the axis, of any length")
    angle: float = said("how far it goes about the axis", "rad", default=2 * np.pi)
    tool: Literal["fixed", "turns"] = "fixed"
    """`fixed` keeps the orientation of the tool, `turns` turns it with the arc."""


class ScrewDescription(MoveDescription):
    """A turn of the tool about an axis while it moves along it."""

    move = Screw
    kind: Literal["screw"]
    axis: Three = said("direction of the axis, of any length")
    angle: float = said("how far the tool turns", "rad")
    pitch: float = said("how far a whole turn goes along the axis", "m", default=0.0)
    center: Three | None = said("a point of the axis, in the base frame", "m", default=None, source="the tip")


class ThroughDescription(MoveDescription):
    """A smooth curve through poses, without a stop."""

    move = Through
    kind: Literal["through"]
    poses: list[list[float]] = said("rows of x, y, z, or of x, y, z, qw, qx, qy, qz", "m")
    times: list[float] | None = said(
        "of each pose; the first is when the move begins", "s", default=None, source="`duration`, or the joints' limits"
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
    """A path of the tool, by inverse kinematics of the arm that the law knows."""

    kind: Literal["tool_path"]
    start: list[float] = said("a posture from which the tool starts, one position per joint", "rad or m")
    pose: Seven | None = said(
        "where the path begins, x, y, z, qw, qx, qy, qz; searched from `start`",
        "m",
        default=None,
        source="where the tool is at `start`",
    )
    moves: list[AnyMove] = Field(default=[])
    """Moves of the tool, each from the end of the move before it."""
    file: FileName | None = None
    """A CSV file with columns time, x, y, z and optionally qw, qx, qy, qz, relative to the folder of the scenario; in
    place of `moves`."""
    text: str | None = None
    """Content of such a file, in place of `file`."""
    hold: Literal["place", "axis", "pose"] = "pose"
    """Requirement on the tool: the `place` of its tip, also its `axis` z, or the whole `pose`."""
    posture: list[float] | None = said(
        "what is liked of an arm that has more joints than it needs", "rad or m", default=None, source="as it starts"
    )
    velocity: Limit | None = said(
        "largest speed of the joints, or `robot`", "rad/s or m/s", default=None, source="none"
    )
    acceleration: Numbers | None = said("largest acceleration", "rad/s² or m/s²", default=None, source="no limit")
    damping: float = said(
        "how much of the pose is given up near a singularity, per unit of force", "m or rad", "[0, 1]", default=0.0
    )
    tolerance: float = said("largest error of the tool between knots", "m and rad", "[1e-9, 1e-2]", default=1e-6)
    begin: float = said("when it begins", "s", ">= 0", default=0.0)

    def build(self, limits: JointLimits | None = None, robot: AbstractRobot | None = None) -> AbstractTrajectory:
        """Build the joint trajectory of the nominal `robot`."""
        assert robot is not None
        pose = None
        if self.pose is not None:
            with located("pose"):
                pose = Pose.of(self.pose[:3], self.pose[3:])
        named = ("hold", "start", "posture", "velocity", "acceleration", "damping", "tolerance", "begin")
        arguments: dict[str, Any] = {name: value for name, value in self.parameters().items() if name in named}
        arguments |= robot_limits(self, limits, "velocity")
        return follow(robot, self._moves(), pose=pose, **arguments).trajectory

    def _moves(self) -> list[AbstractMove]:
        sources = [name for name in ("moves", "file", "text") if getattr(self, name)]
        if len(sources) != 1:
            raise DefinitionError("needs one of `moves`, `file` and `text`")
        if self.moves:
            return [move.build() for move in self.moves]
        with located(sources[0]):
            return [Through.from_csv(self.file if self.file is not None else f"{self.text}\n")]
