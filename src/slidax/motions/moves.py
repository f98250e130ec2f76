"""Moves of a tool: lines, arcs, screws, pauses and smooth curves through poses, each with its time law."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from slidax.arms.chain import Pose, numbers, unit_quaternion
from slidax.arms.curves import AbstractCurve, Array, Helix, Spline, constant_pose
from slidax.arms.rotations import angle_between, axis_and_angle, matrix_of
from slidax.core.errors import DefinitionError, each_of, float_array, plain_name

from .splines import quintic_spline
from .table import TIME_UNITS
from .table_files import csv_lines, numbers_in, unit_of

RAMP = 1.5
"""Peak acceleration of a smooth velocity ramp, relative to its mean acceleration."""


class TimeLaw(NamedTuple):
    """Curve parameter s as a function of time: piecewise polynomials with continuous second derivative.

    s goes from 0 at the start of the curve to 1 at its end.

    - `times`: knots, from 0 on [k], s.
    - `coefficients`: coefficients in powers of the time since the start of the piece, lowest first [k-1 powers].
    """

    times: Array
    coefficients: Array

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return s, ds/dt and d²s/dt², one value per time in `t` [s]."""
        piece = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.coefficients) - 1)
        x = t - self.times[piece]
        values = []
        coefficients = self.coefficients
        for order in range(3):
            value = np.zeros_like(x)
            for column in coefficients.T[::-1]:
                value = value * x + column[piece]
            values.append(value)
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1]) if order < 2 else coefficients
        s, rate, curvature = values
        return np.clip(s, 0.0, 1.0), rate, curvature

    def stretched(self, factor: float) -> TimeLaw:
        """Return the law with all times multiplied by a factor."""
        powers = np.arange(self.coefficients.shape[1])
        return TimeLaw(self.times * factor, self.coefficients / factor**powers)


def minimum_jerk_law(duration: float) -> TimeLaw:
    """Return `s = 10 z³ - 15 z⁴ + 6 z⁵`, `z = t/T` with the duration T: minimum jerk from rest to rest."""
    return TimeLaw(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0, 10.0, -15.0, 6.0]])).stretched(duration)


def linear_law(duration: float) -> TimeLaw:
    """Return `s = t/T` with the duration T, for a curve whose first two derivatives by s are 0 at both ends."""
    return TimeLaw(np.array([0.0, duration]), np.array([[0.0, 1.0 / duration]]))


def ramped_law(length: float, speed: float, acceleration: float) -> TimeLaw:
    """Return a time law of three phases: a smooth ramp up to a speed, constant speed, and an equal ramp down.

    During the ramp up the speed is `v (3 z² - 2 z³)`, with the peak speed v and z from 0 to 1. v is `speed`, or less on
    a short curve.

    - `length`: length of the curve, m or rad.
    - `speed`, `acceleration`: limits along the curve, m/s and m/s², or rad/s and rad/s².
    """
    speed = min(speed, float(np.sqrt(length * acceleration / RAMP)))
    ramp = RAMP * speed / acceleration
    even = max(length / speed - ramp, 0.0)
    v, r = speed / length, ramp
    up = [0.0, 0.0, 0.0, v / r**2, -v / (2 * r**3)]
    start = v * r / 2
    down = [start + v * even, v, 0.0, -v / r**2, v / (2 * r**3)]
    if even <= 1e-9 * r:
        return TimeLaw(np.array([0.0, r, 2 * r]), np.array([up, [start, *down[1:]]]))
    return TimeLaw(np.array([0.0, r, r + even, 2 * r + even]), np.array([up, [start, v, 0.0, 0.0, 0.0], down]))


Numbers = Sequence[float] | Array


class TimedCurve(NamedTuple):
    """The curve and time law of a move from a start pose.

    - `curve`: pose of the tool as a function of the curve parameter.
    - `law`: curve parameter as a function of time; its duration is 1 s if `free`.
    - `free`: True if the duration is still to be computed from the joint limits.
    - `length`: length of the tip's path [m]; for a pure rotation, its angle [rad]. For `Through`, the sum of the
      distances between consecutive poses [m], in which a rotation counts 0.1 m per rad.
    - `end`: pose at the end.
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
    """A move of the tool from rest to rest, which begins where the previous move ended.

    With a `duration` the move has minimum jerk along its path. With `speed` and `acceleration` it has constant speed
    between two smooth ramps. Without these it has minimum jerk and the shortest time that the joint limits allow.

    - `duration`: duration of the move [s].
    - `speed`: largest speed of the tip, m/s; for a pure rotation, rad/s.
    - `acceleration`: largest acceleration along the path, m/s² or rad/s²; only together with `speed`.
    """

    duration: float | None = None
    speed: float | None = None
    acceleration: float | None = None

    @abstractmethod
    def timed_curve(self, pose: Pose) -> TimedCurve:
        """Return the curve and the time law of the move for a start pose.

        Raises DefinitionError if the move is not possible from there.
        """

    def _timed(self, curve: AbstractCurve, length: float, end: Pose, unit: str = "m") -> TimedCurve:
        name = type(self).__name__
        for field in ("duration", "speed", "acceleration"):
            value = getattr(self, field)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise DefinitionError(f"`{name}.{field}` must be > 0 and finite; got {value:g}", where=field)
        if length < 1e-9:
            raise DefinitionError(
                f"`{name}` must change the position or the orientation of the tool; use `Pause` to stand still"
            )
        if self.duration is not None:
            if self.speed is not None or self.acceleration is not None:
                raise DefinitionError(f"`{name}` takes either `duration`, or `speed` and `acceleration`, not both")
            return TimedCurve(curve, minimum_jerk_law(self.duration), False, length, end, unit)
        if (self.speed is None) != (self.acceleration is None):
            missing = "speed" if self.speed is None else "acceleration"
            raise DefinitionError(f"`{name}.{missing}` is missing: give `speed` and `acceleration`, or neither")
        if self.speed is None or self.acceleration is None:
            return TimedCurve(curve, minimum_jerk_law(1.0), True, length, end, unit)
        return TimedCurve(curve, ramped_law(length, self.speed, self.acceleration), False, length, end, unit)


@dataclass(frozen=True, kw_only=True, eq=False)
class Line(AbstractMove):
    """A straight line of the tip. The tool rotates about one axis, in proportion to the path (slerp).

    - `to`: target of the tip in the base frame [3], m.
    - `by`: displacement of the tip in the base frame [3], m, instead of `to`.
    - `quaternion`: orientation at the end, w, x, y, z; unchanged by default.
    - `duration`, `speed`, `acceleration`: as in `AbstractMove`.
    """

    to: Numbers | None = None
    by: Numbers | None = None
    quaternion: Numbers | None = None

    def timed_curve(self, pose: Pose) -> TimedCurve:
        if self.to is not None and self.by is not None:
            raise DefinitionError("`Line` takes either `to` or `by`, not both")
        shift = np.zeros(3)
        if self.to is not None:
            shift = numbers("Line.to", self.to, 3) - pose.position
        if self.by is not None:
            shift = numbers("Line.by", self.by, 3)
        end = pose.rotation
        if self.quaternion is not None:
            end = matrix_of(unit_quaternion("Line.quaternion", self.quaternion))
        axis, spin = axis_and_angle(end @ pose.rotation.T)
        if math.pi - spin < 1e-6:
            raise DefinitionError(
                "`Line` rotates the tool by half a turn, whose direction is ambiguous: use two lines, or a `Screw`"
            )
        curve = _helix(pose, shift=shift, spin_axis=axis, spin=spin)
        length = float(np.linalg.norm(shift))
        end_pose = Pose(pose.position + shift, end)
        return self._timed(curve, length, end_pose) if length > 1e-9 else self._timed(curve, spin, end_pose, "rad")


@dataclass(frozen=True, kw_only=True, eq=False)
class Circle(AbstractMove):
    """An arc of the tip about an axis.

    - `center`: a point on the axis, in the base frame [3], m.
    - `axis`: direction [3], of any length.
    - `angle`: rad, right-handed about the axis; negative for the other direction, more than 2π for several turns.
    - `tool`: "fixed" keeps the tool's orientation, "turns" rotates the tool with the arc.
    - `duration`, `speed`, `acceleration`: as in `AbstractMove`.
    """

    center: Numbers
    axis: Numbers
    angle: float = 2 * math.pi
    tool: Literal["fixed", "turns"] = "fixed"

    def timed_curve(self, pose: Pose) -> TimedCurve:
        if self.tool not in ("fixed", "turns"):
            raise DefinitionError(f'`Circle.tool` must be "fixed" or "turns"; got `{self.tool}`')
        center, axis = numbers("Circle.center", self.center, 3), _direction("Circle", self.axis)
        arm = pose.position - center
        radius = float(np.linalg.norm(np.cross(axis, arm)))
        if radius < 1e-6:
            raise DefinitionError("the axis of `Circle` goes through the tip, so its radius is 0: move `center`")
        return _rotation_move(self, pose, center, axis, self.angle, np.zeros(3), self.tool == "turns", radius)


@dataclass(frozen=True, kw_only=True, eq=False)
class Screw(AbstractMove):
    """A rotation of the tool about an axis while it moves along that axis.

    - `center`: a point on the axis, in the base frame [3], m; the tip by default.
    - `axis`: direction [3], of any length.
    - `angle`: rad, right-handed about the axis; negative for the other direction.
    - `pitch`: travel along the axis per turn, m.
    - `duration`, `speed`, `acceleration`: as in `AbstractMove`.
    """

    center: Numbers | None = None
    axis: Numbers
    angle: float
    pitch: float = 0.0

    def timed_curve(self, pose: Pose) -> TimedCurve:
        center = pose.position if self.center is None else numbers("Screw.center", self.center, 3)
        axis = _direction("Screw", self.axis)
        if not math.isfinite(self.pitch):
            raise DefinitionError(f"`Screw.pitch` must be finite; got {self.pitch:g}")
        shift = axis * self.pitch * self.angle / (2 * math.pi)
        radius = float(np.linalg.norm(np.cross(axis, pose.position - center)))
        return _rotation_move(self, pose, center, axis, self.angle, shift, True, radius)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pause(AbstractMove):
    """The tool stands still for `duration` [s]; `speed` and `acceleration` are not allowed."""

    def timed_curve(self, pose: Pose) -> TimedCurve:
        if self.duration is None or not (math.isfinite(self.duration) and self.duration > 0):
            raise DefinitionError("`Pause.duration` must be given, > 0 and finite")
        if self.speed is not None or self.acceleration is not None:
            raise DefinitionError("`Pause` takes only a `duration`: leave out `speed` and `acceleration`")
        return TimedCurve(
            constant_pose(pose.rotation, pose.position), minimum_jerk_law(self.duration), False, 0.0, pose
        )


def _rotation_move(
    move: AbstractMove,
    pose: Pose,
    center: Array,
    axis: Array,
    angle: float,
    shift: Array,
    tool: bool,
    radius: float,
) -> TimedCurve:
    """Return the curve of a rotation about an axis, plus a shift; `tool` is True if the tool turns with it."""
    name = type(move).__name__
    if not math.isfinite(angle) or angle == 0:
        raise DefinitionError(f"`{name}.angle` must be finite and not 0; got {angle:g}", where="angle")
    if abs(angle) > 200 * math.pi:
        raise DefinitionError(f"`{name}.angle` must be at most 100 turns, in rad; got {angle:g}", where="angle")
    spin = angle if tool else 0.0
    curve = _helix(pose, shift=shift, center=center, axis=axis, angle=angle, spin_axis=axis, spin=spin)
    rotation, position = curve.at(1.0)
    far = math.hypot(radius * angle, float(np.linalg.norm(shift)))
    end = Pose(position, _orthonormal(rotation))
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
        position=pose.position,
        shift=np.asarray(shift, float),
        center=pose.position if center is None else np.asarray(center, float),
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
    """Return the rotation matrix nearest to a matrix, to remove rounding errors."""
    left, _, right = np.linalg.svd(rotation)
    return left @ right


LARGEST_ROTATION = np.deg2rad(120.0)
"""Largest rotation between consecutive poses, rad, for which the spline stays near the slerp."""

NEAR = 1e-4
"""Largest difference, m or rad, of the first timed pose from the tool's pose, which then replaces the first pose."""

MOST_POSES = 100_000
"""Most rows in a table of poses."""

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Factors that convert units of positions to m."""

COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, kw_only=True, eq=False)
class Through(AbstractMove):
    """A smooth curve through poses without stops in between, at rest at both ends.

    Position and quaternion are quintic splines with four continuous derivatives; the quaternion is then normalised. The
    curve begins where the previous move ended. Do not repeat this pose in `poses`. Only with `times` the first row must
    be this pose. The tool may rotate by up to 120° from a pose to the next.

    - `poses`: rows of x, y, z [m], or of x, y, z, qw, qx, qy, qz; without quaternions the tool keeps its orientation.
    - `times`: increasing time of each row [s]; only differences count, since the move starts after the previous one.
    - `duration`: duration of the whole move [s]; not together with `times`.
    - `speed`, `acceleration`: not allowed for this move.
    """

    poses: Sequence[Sequence[float]] | Array
    times: Sequence[float] | Array | None = None

    @staticmethod
    def from_csv(source: str | Path) -> Through:
        """Read the poses from a CSV file with columns x, y, z, optionally qw, qx, qy, qz, and optionally time.

        The first line names the columns, in any order. Units are m and s unless a name has another one in brackets:
        `x [mm]`, `time [ms]`.

        - `source`: path of the file, or its text; a string with a line break is taken as text.

        Raises DefinitionError, with line and column, if the columns, units or numbers are invalid.
        """
        name, form, lines = csv_lines(source, "time,x,y,z")
        titles, where = form.titles, f"{name}, line {form.header}"
        named = [unit_of(title) for title in titles]
        header = [title.casefold() for title, _ in named]
        wanted = COLUMNS if "qw" in header else COLUMNS[:3]
        mistakes = [f"`{column}` is missing" for column in wanted if column not in header]
        mistakes += [f"`{plain_name(title)}` is unknown" for title in header if title not in (*wanted, "time")]
        mistakes += [f"`{title}` occurs twice" for title in header if header.count(title) > 1]
        if mistakes:
            raise DefinitionError(
                f"{where}: the columns must be x, y, z, optionally qw, qx, qy, qz, and optionally time: {mistakes[0]}"
            )
        values, rows = numbers_in(name, titles, lines, MOST_POSES)
        if not len(rows):
            raise DefinitionError(f"{name} has no row below its column titles")
        for column, (_, unit) in enumerate(named):
            kind = header[column]
            known = TIME_UNITS if kind == "time" else LENGTHS if kind in COLUMNS[:3] else {"": 1.0, "1": 1.0}
            if unit is not None and unit not in known:
                words = ", ".join(unit_name for unit_name in known if unit_name)
                raise DefinitionError(
                    f"{where}, column `{plain_name(titles[column])}`: the unit must be one of {words}"
                )
            values[:, column] *= 1.0 if unit is None else known[unit]
        times = values[:, header.index("time")] if "time" in header else None
        return Through(poses=values[:, [header.index(column) for column in wanted]], times=times)

    def timed_curve(self, pose: Pose) -> TimedCurve:
        if self.speed is not None or self.acceleration is not None:
            raise DefinitionError(
                "`Through` takes no `speed` and no `acceleration`: set `times` or a `duration`, or neither, for the "
                "shortest duration within the joint limits"
            )
        rows = _rows(self.poses)
        own = np.concatenate([pose.position, pose.quaternion])
        if rows.shape[1] == 3:
            rows = np.concatenate([rows, np.broadcast_to(own[3:], (len(rows), 4))], axis=1)
        if self.times is None:
            rows = np.concatenate([own[None], rows])
            rows = _aligned(rows, first=1)
            steps = _steps(rows)
            if (steps < 1e-9).any():
                row = int(np.argmin(steps)) + 1
                raise DefinitionError(f"row {row} of `Through.poses` is the same as the pose before it: leave it out")
            knots = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
            curve = Spline(knots=knots, coefficients=quintic_spline(knots, rows))
            return self._timed(curve, float(steps.sum()), _pose(rows[-1]))
        if self.duration is not None:
            raise DefinitionError("`Through` takes either `times` or a `duration`, not both")
        times = float_array("Through.times", self.times)
        increasing = times.shape == (len(rows),) and np.isfinite(times).all() and (np.diff(times) > 0).all()
        if len(rows) < 2 or not increasing:
            raise DefinitionError(
                f"`Through.times` must be increasing, two or more times, one for {each_of(len(rows), 'pose')}"
            )
        first = _pose(rows[0])
        distance = float(np.linalg.norm(first.position - pose.position))
        angle = float(angle_between(first.rotation, pose.rotation))
        if distance > NEAR or angle > NEAR:
            raise DefinitionError(
                f"row 1 of `Through.poses` must be the tool's pose at the start of the move, {_position_text(pose)}; "
                f"it is {distance:.3g} m and {np.rad2deg(angle):.3g} degrees off: insert a `Line` to it before this "
                "move"
            )
        rows = _aligned(np.concatenate([own[None], rows[1:]]), first=0)
        span = float(times[-1] - times[0])
        knots = (times - times[0]) / span
        curve = Spline(knots=knots, coefficients=quintic_spline(knots, rows))
        return TimedCurve(curve, linear_law(span), False, float(_steps(rows).sum()), _pose(rows[-1]))


def _rows(poses: object) -> Array:
    try:
        rows = np.asarray(poses, float)
    except (TypeError, ValueError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[1] not in (3, 7) or not len(rows):
        raise DefinitionError("`Through.poses` must be rows that are all x, y, z, or all x, y, z, qw, qx, qy, qz")
    if not np.isfinite(rows).all():
        raise DefinitionError(
            f"row {int(np.argmax(~np.isfinite(rows).all(axis=1))) + 1} of `Through.poses` must be finite"
        )
    if rows.shape[1] == 7:
        size = np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
        if (size < 1e-6).any():
            raise DefinitionError(
                f"row {int(np.argmin(size)) + 1} of `Through.poses` must have a quaternion of length > 0"
            )
        rows = np.concatenate([rows[:, :3], rows[:, 3:] / size], axis=1)
    return rows


def _aligned(rows: Array, first: int) -> Array:
    """Return rows of poses with the signs of the quaternions such that consecutive quaternions are close.

    The quaternions q and -q are the same orientation.

    - `first`: index of the row that is row 1 in messages.

    Raises DefinitionError if consecutive poses differ by more than `LARGEST_ROTATION`.
    """
    rows = rows.copy()
    for row in range(1, len(rows)):
        if rows[row, 3:] @ rows[row - 1, 3:] < 0:
            rows[row, 3:] *= -1
        cosine = min(float(rows[row, 3:] @ rows[row - 1, 3:]), 1.0)
        if 2 * np.arccos(cosine) > LARGEST_ROTATION:
            raise DefinitionError(
                f"row {row - first + 1} of `Through.poses` is rotated by {np.rad2deg(2 * np.arccos(cosine)):.0f} "
                f"degrees from the pose before it; the most is {np.rad2deg(LARGEST_ROTATION):.0f}: add a pose between"
            )
    return rows


def _steps(rows: Array) -> Array:
    """Return the distances between k consecutive poses [k-1], m; a rotation counts with a lever arm of 0.1 m."""
    positions = np.linalg.norm(np.diff(rows[:, :3], axis=0), axis=1)
    cosines = np.clip(np.sum(rows[1:, 3:] * rows[:-1, 3:], axis=1), -1.0, 1.0)
    return np.hypot(positions, 0.1 * 2 * np.arccos(cosines))


def _pose(row: Array) -> Pose:
    return Pose(row[:3], matrix_of(row[3:] / np.linalg.norm(row[3:])))


def _position_text(pose: Pose) -> str:
    return f"[{', '.join(f'{x:.4g}' for x in pose.position)}] m"
