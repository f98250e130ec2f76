"""A motion as a table of joint positions over time, and its checks: jumps, limits and units."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, DefinitionWarning, count_noun, nearest_word
from slidax.core.joint_names import are_numbered, match_names, quote_names

from .limits import MotionLimits, joint_label
from .trajectory import AbstractPiecewisePolynomial

JOINTS = "`joints` (on the command line `--set 'trajectory.joints=[...]'`)"

TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "μs": 1e-6, "ns": 1e-9}
"""Factors that convert units of time to s."""

DEGREE = np.pi / 180

UNITS = {
    "positions": {"rad": 1.0, "m": 1.0, "deg": DEGREE, "°": DEGREE, "degrees": DEGREE, "mm": 1e-3},
    "velocities": {"rad/s": 1.0, "m/s": 1.0, "deg/s": DEGREE, "°/s": DEGREE, "rpm": np.pi / 30, "mm/s": 1e-3},
    "accelerations": {"rad/s2": 1.0, "m/s2": 1.0, "deg/s2": DEGREE, "°/s2": DEGREE, "mm/s2": 1e-3},
}
"""Factors that convert the units of columns to SI units."""

CLOCK = 1e6
"""A first time beyond this [s] looks like a clock's, and would leave too few digits for the motion."""


@dataclass(frozen=True)
class MotionTable:
    """Positions over time, optionally with velocities and accelerations.

    - `source`: origin of the data, for messages.
    - `joints`: joint names; empty if the table has none.
    - `rows`: label of each row in messages, such as `line 7`.
    - `times`: [k], s.
    - `positions`: [k n], rad or m.
    - `velocities`, `accelerations`: [k n], or None.
    - `unit_is_known`: True if the data or the user gives the unit of the times.

    Raises DefinitionError for fewer than two rows, times that do not increase, numbers that are not finite, or
    accelerations without velocities.
    """

    source: str
    joints: tuple[str, ...]
    rows: Sequence[str]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64] | None = None
    accelerations: NDArray[np.float64] | None = None
    unit_is_known: bool = False

    def __post_init__(self) -> None:
        if len(self.times) < 2:
            raise DefinitionError(
                f"{self.source} has {count_noun(len(self.times), 'row')}: "
                "a motion needs two or more, and starts at the first"
            )
        self._require_finite("time", self.times[:, None])
        for field in ("position", "velocity", "acceleration"):
            values = self._values(field)
            if values is not None:
                self._require_finite(field, values)
        wrong = np.diff(self.times) <= 0
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            again = self.times[row] == self.times[row - 1]
            rule = "two rows at one time would be a jump; leave one of them out" if again else "the times must increase"
            raise DefinitionError(
                f"{self.row_label(row)}: time {self.times[row]:g} s comes after {self.times[row - 1]:g} s: {rule}"
            )
        if self.accelerations is not None and self.velocities is None:
            raise DefinitionError(f"{self.source} has accelerations but no velocities: give both, or neither")

    def row_label(self, row: int) -> str:
        """Return the source and the label of a row, by its index from 0, for a message."""
        return f"{self.source}, {self.rows[row]}"

    def shifted(self, start: float | None) -> MotionTable:
        """Return the table with its first row at the time `start` [s]; None keeps the times.

        Raises DefinitionError if the first time is then below 0 or above `CLOCK`.
        """
        moved = self if start is None else replace(self, times=self.times - self.times[0] + start)
        first = float(moved.times[0])
        if not 0 <= first <= CLOCK:
            what = "a motion starts at 0 or later" if first < 0 else "this looks like the time of a clock"
            raise DefinitionError(
                f"{self.row_label(0)}: time {first:g} s: {what}; shift the table to start at 0 with `start=0`"
            )
        return moved

    def _values(self, field: str) -> NDArray[np.float64] | None:
        return {"position": self.positions, "velocity": self.velocities, "acceleration": self.accelerations}[field]

    def _require_finite(self, field: str, values: NDArray[np.float64]) -> None:
        if not np.all(np.isfinite(values)):
            row, joint = (int(index) for index in np.argwhere(~np.isfinite(values))[0])
            of = "" if field == "time" else f" of {joint_label(joint, self.joints)}"
            raise DefinitionError(f"{self.row_label(row)}: the {field}{of} must be a finite number")


def columns_of(source: str, names: Sequence[str], joints: Sequence[str] | None) -> list[int]:
    """Return the column index of each joint in a table, in the order of the robot's joints, by matching their names.

    - `source`: origin of the table, for messages.
    - `names`: column names.
    - `joints`: the robot's joint names; None for all columns in their order.

    Columns of other joints are dropped with a DefinitionWarning. Raises DefinitionError for a missing joint, or a name
    that occurs twice.
    """
    _require_distinct(names, f"{source} has")
    if joints is None:
        return list(range(len(names)))
    _require_distinct(joints, "`joints` has")
    indices = match_names(names, joints)
    absent = [name for name in joints if name not in indices]
    if absent == list(joints) and are_numbered(joints):
        return _in_their_order(source, names, joints)
    if absent:
        hint = nearest_word(absent[0], names) if len(absent) == 1 else f"there are: {quote_names(names)}"
        hint = hint if hint.endswith("?") else f"{hint}."
        raise DefinitionError(
            f"{source} lacks the joint{'s' * (len(absent) > 1)} {quote_names(absent)}; {hint} "
            f"If the file has other names for {quote_names(joints)}, list the file's names, in this order, as {JOINTS}"
        )
    columns = [indices[name] for name in joints]
    others = [name for index, name in enumerate(names) if index not in columns]
    if others:
        verb = "is not a joint of the robot and is" if len(others) == 1 else "are not joints of the robot and are"
        warnings.warn(DefinitionWarning(f"{source}: {quote_names(others)} {verb} left out"), stacklevel=2)
    return columns


def _in_their_order(source: str, names: Sequence[str], joints: Sequence[str]) -> list[int]:
    """Return the indices of the columns in their own order, for a robot whose joints have no names."""
    if len(names) != len(joints):
        raise DefinitionError(
            f"{source} moves {count_noun(len(names), 'joint')}, {quote_names(names)}, but the robot has {len(joints)}, "
            f"which have no names: list the file's names for them, in the robot's order, as {JOINTS}"
        )
    if len(joints) > 1:
        warning = (
            f"{source}: the robot's joints have no names, so the columns {quote_names(names)} move "
            f"{quote_names(joints)} in this order; to confirm it, or for another order, list the names as {JOINTS}"
        )
        warnings.warn(DefinitionWarning(warning), stacklevel=2)
    return list(range(len(names)))


def _require_distinct(names: Sequence[str], owner: str) -> None:
    for name in names:
        if list(names).count(name) > 1:
            raise DefinitionError(f"{owner} the joint `{name}` more than once")


SIDE = 5
"""Rows on each side of a jump that determine the velocities before and after."""

CLEAR = 12.0
"""A velocity change is a jump if it is this many times the residual of the lines through the rows around it."""

PART, LEAST = 0.1, 0.01
"""Smaller velocity changes are due to rounding: a fraction of the joint's top speed, and a speed in rad/s or m/s."""


class VelocityJump(NamedTuple):
    """A velocity jump between two rows of a table.

    - `joint`: joint index, from 0.
    - `row`: index of the row at the left end of the interval, from 0.
    - `before`, `after`: velocities, rad/s or m/s.
    - `end`: -1 at the start of the table, 1 at its end, 0 inside.
    """

    joint: int
    row: int
    before: float
    after: float
    end: int


def velocity_jump(times: NDArray[np.float64], positions: NDArray[np.float64]) -> VelocityJump | None:
    """Return the largest velocity jump of a table of positions, or None if there is none.

    The joints are at rest before the first row and after the last one. For each interval between two rows, straight
    lines are fitted to the velocities before and after it. There is a jump if the two lines differ by much more in the
    middle of the interval than their residuals and a jump in acceleration explain. A table of a few waypoints has no
    jump, since it does not define the motion between them.

    - `times`: [k], s, increasing.
    - `positions`: [k n].
    """
    width = np.diff(times)
    velocity = np.diff(positions, axis=0) / width[:, None]
    width = np.concatenate([np.full(SIDE, width[0]), width, np.full(SIDE, width[-1])])
    still = np.zeros((SIDE, positions.shape[1]))
    velocity = np.concatenate([still, velocity, still])
    middle = np.cumsum(width) - width / 2
    gaps = np.arange(SIDE, len(width) - SIDE)
    before = _line(middle, velocity, gaps[:, None] + np.arange(-SIDE, 0), middle[gaps])
    after = _line(middle, velocity, gaps[:, None] + np.arange(1, SIDE + 1), middle[gaps])
    change = np.abs(after.value - before.value)
    top = np.abs(velocity).max(axis=0)
    explained = np.maximum(
        np.abs(after.slope - before.slope) * width[gaps][:, None], CLEAR * np.maximum(before.rest, after.rest)
    )
    jumps = change > np.maximum(explained, np.maximum(LEAST, PART * top))
    if not jumps.any():
        return None
    row, joint = (int(index) for index in np.unravel_index(np.argmax(np.where(jumps, change, 0.0)), change.shape))
    last = len(gaps) - 1
    end = -1 if row == 0 else 1 if row == last else 0
    return VelocityJump(joint, row, float(before.value[row, joint]), float(after.value[row, joint]), end)


class _Line(NamedTuple):
    """Straight lines fitted to velocities, one for each window of rows and each joint, [windows n].

    - `value`: the line's velocity at a time.
    - `slope`: its acceleration.
    - `rest`: largest residual of the fit.
    """

    value: NDArray[np.float64]
    slope: NDArray[np.float64]
    rest: NDArray[np.float64]


def _line(
    times: NDArray[np.float64], velocity: NDArray[np.float64], window: NDArray[np.intp], at: NDArray[np.float64]
) -> _Line:
    """Fit one straight line per window and joint by least squares; the values are those at the times `at`."""
    t = times[window] - at[:, None]
    mean = t.mean(axis=1, keepdims=True)
    weights = (t - mean) / np.sum((t - mean) ** 2, axis=1, keepdims=True)
    v = velocity[window]
    slope = np.einsum("ws,wsn->wn", weights, v)
    centre = v.mean(axis=1)
    value = centre - slope * mean
    rest = np.abs(v - (value[:, None] + slope[:, None] * t[:, :, None])).max(axis=1)
    return _Line(value, slope, rest)


BEYOND_ARMS = 200.0
"""Acceleration that no arm reaches, rad/s² or m/s²; the limit if the user sets none."""

RESTING = 1e-6
"""Largest velocity in the first and last row that is due to rounding in the file, rad/s or m/s."""

DENSE, SLOW = 20, 0.02
"""Number of rows, and velocity [rad/s or m/s]: a longer table that stays slower may have its times in another unit."""

TWO_TURNS = 4 * np.pi
"""Positions beyond two turns [rad] are rare for an arm and common for degrees."""


def at_rest_outside(table: MotionTable) -> MotionTable:
    """Return the table with velocities of exactly zero in its first and last row, if it has velocities.

    Raises DefinitionError, with joint, time, value and remedy, if a velocity there exceeds `RESTING`.
    """
    if table.velocities is None:
        return table
    for row, end, side in ((0, "start", "before"), (len(table.times) - 1, "end", "after")):
        moving = np.abs(table.velocities[row])
        if np.any(moving > RESTING):
            joint = int(np.argmax(moving))
            raise DefinitionError(
                f"{table.row_label(row)}: {joint_label(joint, table.joints)} has a velocity of "
                f"{table.velocities[row, joint]:g} rad/s (or m/s) at its {end}, t = {table.times[row]:g} s, but the "
                f"joint is at rest {side} that, so its velocity would jump: make it 0 there, or add rows in which the "
                "joint comes to rest"
            )
    velocities = table.velocities.copy()
    velocities[[0, -1]] = 0.0
    return replace(table, velocities=velocities)


def require_no_jump(motion: AbstractPiecewisePolynomial, table: MotionTable) -> None:
    """Raise DefinitionError, with joint, time, value and remedy, if a table of positions only has a velocity jump."""
    jump = None if table.velocities is not None else velocity_jump(table.times, table.positions)
    if jump is None:
        return
    row = jump.row if jump.end < 1 else jump.row + 1
    where = {-1: "at its start, ", 0: "at ", 1: "at its end, "}[jump.end]
    needed = motion.extremes(2).size[jump.joint]
    raise DefinitionError(
        f"{table.row_label(row)}: the velocity of {joint_label(jump.joint, table.joints)} jumps {where}t = "
        f"{table.times[row]:g} s, from {jump.before:.3g} to {jump.after:.3g} rad/s (or m/s) within one row: add rows "
        "in which it changes, give velocities too, or let `MinimumJerk.within` choose the times; or, if the arm "
        f"reaches {np.ceil(needed):.4g} rad/s² (or m/s²), set that limit as `acceleration`"
    )


def warn_of_slow_times(motion: AbstractPiecewisePolynomial, table: MotionTable) -> None:
    """Warn if the time unit is unknown, and row spacing and speed suggest that the times are not in seconds."""
    spacing = float(np.median(np.diff(table.times)))
    fastest = float(motion.extremes(1).size.max())
    if table.unit_is_known or len(table.times) < DENSE or spacing < 0.5 or not 0.0 < fastest < SLOW:
        return
    unit = next(unit for unit, factor in (("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3)) if spacing * factor > 1e-4)
    warnings.warn(
        DefinitionWarning(
            f"{table.source} has {len(table.times)} rows, {spacing:.4g} s apart, and no joint moves faster than "
            f"{fastest:.2g} rad/s (or m/s): are the times in {unit}? Then set `time_unit` to {unit}, otherwise to s"
        ),
        stacklevel=3,
    )


def require_within(motion: AbstractPiecewisePolynomial, table: MotionTable, limits: MotionLimits) -> None:
    """Raise DefinitionError, with the likely cause, if the motion exceeds a limit."""
    largest = float(np.abs(table.positions).max())
    degrees = f"; positions go to {largest:.4g}: are they degrees? They must be rad or m" if largest > TWO_TURNS else ""
    limits.require(motion, table.source, table.joints, degrees, degrees or _rate_hint(table))


def _rate_hint(table: MotionTable) -> str:
    """Return the likely cause of a velocity or acceleration above its limit: a mistake in velocities or times."""
    rates = np.abs(np.diff(table.positions, axis=0) / np.diff(table.times)[:, None])
    if table.velocities is not None:
        mean_speed = float(np.abs((table.velocities[1:] + table.velocities[:-1]) / 2).mean())
        implied = float(rates.mean())
        if min(mean_speed, implied) > LEAST and not 0.1 * implied <= mean_speed <= 10 * implied:
            return (
                f"; the velocities are {mean_speed / implied:.3g} times those that follow from positions and times: "
                "are they in rad/s or m/s?"
            )
    row = int(np.argmax(rates.max(axis=1)))
    return (
        f"; the fastest rows are {table.rows[row]} and {table.rows[row + 1]}, "
        f"{table.times[row + 1] - table.times[row]:.3g} s apart: is there a step in the table, or a time too short?"
    )
