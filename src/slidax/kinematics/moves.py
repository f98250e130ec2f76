"""The moves of a tool, and the curves that they become."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from slidax._errors import DefinitionError

from .curve import AbstractCurve, Helix, standing
from .pose import Pose, numbers, unit_quaternion
from .quaternion import axis_and_angle, matrix_of
from .series import Array
from .time_law import TimeLaw, cruising, smoothest

Numbers = Sequence[float] | Array


class Bound(NamedTuple):
    """A move from the pose where the previous one ended.

    - `law`: time law; for a move as fast as the joints allow, with a duration of 1 s.
    - `free`: True if the joint limits decide the duration.
    - `length`: of the tip's path [m], or of a pure rotation, the angle [rad].
    - `end`: the last pose.
    - `unit`: unit of the length.
    """

    curve: AbstractCurve
    law: TimeLaw
    free: bool
    length: float
    end: Pose
    unit: str = "m"


@dataclass(frozen=True, kw_only=True, eq=False)
class AbstractMove:
    """A move from rest to rest, which begins where the previous one ended.

    With a `duration` the move has minimum jerk along its path. With `speed` and `acceleration` it has constant speed
    between two smooth ramps. With neither it takes the shortest time that the joint limits allow.

    - `duration`: [s].
    - `speed`: largest speed of the tip, m/s; for a pure rotation, rad/s.
    - `acceleration`: largest acceleration along the path, m/s² or rad/s²; only together with `speed`.
    """

    duration: float | None = None
    speed: float | None = None
    acceleration: float | None = None

    @abstractmethod
    def bound(self, pose: Pose) -> Bound:
        """Return the move from a start pose.

        Raises DefinitionError if the move is not possible from there.
        """

    def _timed(self, curve: AbstractCurve, length: float, end: Pose, unit: str = "m") -> Bound:
        name = type(self).__name__
        for field in ("duration", "speed", "acceleration"):
            value = getattr(self, field)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise DefinitionError(f"`{name}.{field}` must be > 0 and finite; got {value:g}", where=field)
        if length < 1e-9:
            raise DefinitionError(f"`{name}` goes nowhere: it must change the place or the orientation of the tool")
        if self.duration is not None:
            if self.speed is not None or self.acceleration is not None:
                raise DefinitionError(f"`{name}` takes either `duration`, or `speed` and `acceleration`")
            return Bound(curve, smoothest(self.duration), False, length, end, unit)
        if (self.speed is None) != (self.acceleration is None):
            missing = "speed" if self.speed is None else "acceleration"
            raise DefinitionError(f"`{name}.{missing}` is missing: give `speed` and `acceleration`, or neither")
        if self.speed is None or self.acceleration is None:
            return Bound(curve, smoothest(1.0), True, length, end, unit)
        return Bound(curve, cruising(length, self.speed, self.acceleration), False, length, end, unit)


@dataclass(frozen=True, kw_only=True, eq=False)
class Line(AbstractMove):
    """A straight line of the tip with an even rotation of the tool about one axis (slerp).

    - `to`: target of the tip in the base frame [3], m.
    - `by`: displacement of the tip in the base frame [3], m, instead of `to`.
    - `quaternion`: orientation at the end, w, x, y, z; unchanged by default.
    - `duration`, `speed`, `acceleration`: as in `AbstractMove`.
    """

    to: Numbers | None = None
    by: Numbers | None = None
    quaternion: Numbers | None = None

    def bound(self, pose: Pose) -> Bound:
        if self.to is not None and self.by is not None:
            raise DefinitionError("`Line` takes either `to` or `by`")
        shift = np.zeros(3)
        if self.to is not None:
            shift = numbers("Line.to", self.to, 3) - pose.place
        if self.by is not None:
            shift = numbers("Line.by", self.by, 3)
        end = pose.rotation
        if self.quaternion is not None:
            end = matrix_of(unit_quaternion("Line.quaternion", self.quaternion))
        axis, spin = axis_and_angle(end @ pose.rotation.T)
        if math.pi - spin < 1e-6:
            raise DefinitionError(
                "`Line` turns the tool by half a turn, for which there are two ways: give a pose between, or a `Screw`"
            )
        curve = _helix(pose, shift=shift, spin_axis=axis, spin=spin)
        far = float(np.linalg.norm(shift))
        there = Pose(pose.place + shift, end)
        return self._timed(curve, far, there) if far > 1e-9 else self._timed(curve, spin, there, "rad")


@dataclass(frozen=True, kw_only=True, eq=False)
class Circle(AbstractMove):
    """An arc of the tip about an axis.

    - `center`: a point of the axis, in the base frame [3], m.
    - `axis`: direction [3], of any length.
    - `angle`: rad; negative for the other direction, more than 2 pi for several turns.
    - `tool`: "fixed" keeps the tool's orientation, "turns" rotates the tool with the arc.
    - `duration`, `speed`, `acceleration`: as in `AbstractMove`.
    """

    center: Numbers
    axis: Numbers
    angle: float = 2 * math.pi
    tool: Literal["fixed", "turns"] = "fixed"

    def bound(self, pose: Pose) -> Bound:
        if self.tool not in ("fixed", "turns"):
            raise DefinitionError(f'`Circle.tool` must be "fixed" or "turns"; got `{self.tool}`')
        center, axis = numbers("Circle.center", self.center, 3), _direction("Circle", self.axis)
        arm = pose.place - center
        radius = float(np.linalg.norm(np.cross(axis, arm)))
        if radius < 1e-6:
            raise DefinitionError("`Circle.center` and `axis` go through the tip, so that the circle has no radius")
        return _turned(self, pose, center, axis, self.angle, np.zeros(3), self.tool == "turns", radius)


@dataclass(frozen=True, kw_only=True, eq=False)
class Screw(AbstractMove):
    """A rotation of the tool about an axis while it moves along that axis.

    - `center`: a point of the axis, in the base frame [3], m; the tip by default.
    - `axis`: direction [3], of any length.
    - `angle`: rad; negative for the other direction.
    - `pitch`: travel along the axis for a whole turn, m.
    - `duration`, `speed`, `acceleration`: as in `AbstractMove`.
    """

    center: Numbers | None = None
    axis: Numbers
    angle: float
    pitch: float = 0.0

    def bound(self, pose: Pose) -> Bound:
        center = pose.place if self.center is None else numbers("Screw.center", self.center, 3)
        axis = _direction("Screw", self.axis)
        if not math.isfinite(self.pitch):
            raise DefinitionError(f"`Screw.pitch` must be finite; got {self.pitch:g}")
        shift = axis * self.pitch * self.angle / (2 * math.pi)
        radius = float(np.linalg.norm(np.cross(axis, pose.place - center)))
        return _turned(self, pose, center, axis, self.angle, shift, True, radius)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pause(AbstractMove):
    """The tool stands still for `duration` [s]; `speed` and `acceleration` are not allowed."""

    def bound(self, pose: Pose) -> Bound:
        if self.duration is None or not (math.isfinite(self.duration) and self.duration > 0):
            raise DefinitionError("`Pause.duration` must be given, > 0 and finite")
        if self.speed is not None or self.acceleration is not None:
            raise DefinitionError("`Pause` takes a `duration` alone")
        return Bound(standing(pose.rotation, pose.place), smoothest(self.duration), False, 0.0, pose)


def _turned(
    move: AbstractMove,
    pose: Pose,
    center: Array,
    axis: Array,
    angle: float,
    shift: Array,
    tool: bool,
    radius: float,
) -> Bound:
    name = type(move).__name__
    if not math.isfinite(angle) or angle == 0:
        raise DefinitionError(f"`{name}.angle` must be finite and not 0; got {angle:g}", where="angle")
    if abs(angle) > 200 * math.pi:
        raise DefinitionError(f"`{name}.angle` must be at most 100 turns, in rad; got {angle:g}", where="angle")
    spin = angle if tool else 0.0
    curve = _helix(pose, shift=shift, center=center, axis=axis, angle=angle, spin_axis=axis, spin=spin)
    rotation, place = curve.at(1.0)
    far = math.hypot(radius * angle, float(np.linalg.norm(shift)))
    end = Pose(place, _orthonormal(rotation))
    return move._timed(curve, far, end) if far > 1e-9 else move._timed(curve, abs(angle), end, "rad")


def _helix(
    pose: Pose,
    *,
    shift: object = (0.0, 0.0, 0.0),
    center: object = None,
    axis: object = (0.0, 0.0, 1.0),
    angle: float = 0.0,
    spin_axis: object = (0.0, 0.0, 1.0),
    spin: float = 0.0,
) -> Helix:
    return Helix(
        rotation=pose.rotation,
        place=pose.place,
        shift=np.asarray(shift, float),
        center=pose.place if center is None else np.asarray(center, float),
        axis=np.asarray(axis, float),
        angle=angle,
        spin_axis=np.asarray(spin_axis, float),
        spin=spin,
    )


def _direction(owner: str, axis: object) -> Array:
    direction = numbers(f"{owner}.axis", axis, 3)
    size = float(np.linalg.norm(direction))
    if size < 1e-9:
        raise DefinitionError(f"`{owner}.axis` must have a direction; got {direction.tolist()}", where="axis")
    return direction / size


def _orthonormal(rotation: Array) -> Array:
    """Project a matrix, slightly skew by rounding, onto the rotations."""
    left, _, right = np.linalg.svd(rotation)
    return left @ right
