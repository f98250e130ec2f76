"""A smooth move through poses, at given times or as fast as the joints allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError, each_of, plain
from slidax.trajectories.csv_table import csv_lines, numbers_in, unit_of
from slidax.trajectories.quintic_spline import quintic_spline
from slidax.trajectories.table import TIME_UNITS

from .curve import Spline
from .moves import AbstractMove, Bound
from .pose import Pose
from .quaternion import angle_between, matrix_of
from .series import Array
from .time_law import linear

LARGEST_ROTATION = np.deg2rad(120.0)
"""Largest rotation between neighbouring poses, rad: up to this the spline stays near the slerp."""

NEAR = 1e-4
"""Largest distance of a table's first row from the tool, m or rad; the row is then moved to the tool."""

MOST_POSES = 100_000
"""Rows of a table."""

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Units of places, in m."""

COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, kw_only=True, eq=False)
class Through(AbstractMove):
    """A smooth curve through poses without stops, at rest at both ends.

    Position and quaternion are quintic splines with four continuous derivatives; the quaternion is then normalised. The
    curve begins where the previous move ended. That pose is not a row of `poses`, unless `times` are given: then the
    first row must be the tool's pose.

    - `poses`: rows of x, y, z [m], or of x, y, z, qw, qx, qy, qz; without quaternions the tool keeps its orientation.
    - `times`: increasing time of each row [s]; the first is the start of the move.
    - `duration`: of the whole move [s]; not together with `times`.
    - `speed`, `acceleration`: not allowed for this move.
    """

    poses: Sequence[Sequence[float]] | Array
    times: Sequence[float] | Array | None = None

    @staticmethod
    def from_csv(source: str | Path) -> Through:
        """Read the poses from a CSV file with columns x, y, z, optionally qw, qx, qy, qz, and optionally time.

        The first line names the columns, in any order. Units are m and s unless a name has another one in brackets:
        `x [mm]`, `time [ms]`.

        - `source`: path, or the text itself, which has a line break in it.

        Raises DefinitionError, with line and column, for another form.
        """
        name, form, lines = csv_lines(source, "time,x,y,z")
        titles, where = form.titles, f"{name}, line {form.header}"
        named = [unit_of(title) for title in titles]
        header = [title.casefold() for title, _ in named]
        wanted = COLUMNS if "qw" in header else COLUMNS[:3]
        mistakes = [f"`{column}` is missing" for column in wanted if column not in header]
        mistakes += [f"`{plain(title)}` is none of them" for title in header if title not in (*wanted, "time")]
        mistakes += [f"`{title}` is there twice" for title in header if header.count(title) > 1]
        if mistakes:
            raise DefinitionError(
                f"{where}: the columns must be x, y, z, perhaps qw, qx, qy, qz, and perhaps time: {mistakes[0]}"
            )
        values, rows = numbers_in(name, titles, lines, MOST_POSES)
        if not len(rows):
            raise DefinitionError(f"{name} has no row below the names of its columns")
        for column, (_, unit) in enumerate(named):
            kind = header[column]
            known = TIME_UNITS if kind == "time" else LENGTHS if kind in COLUMNS[:3] else {"": 1.0, "1": 1.0}
            if unit is not None and unit not in known:
                words = ", ".join(unit_name for unit_name in known if unit_name)
                raise DefinitionError(f"{where}, column `{plain(titles[column])}`: the unit must be one of {words}")
            values[:, column] *= 1.0 if unit is None else known[unit]
        times = values[:, header.index("time")] if "time" in header else None
        return Through(poses=values[:, [header.index(column) for column in wanted]], times=times)

    def bound(self, pose: Pose) -> Bound:
        if self.speed is not None or self.acceleration is not None:
            raise DefinitionError("`Through` takes `times` or a `duration`, or leaves its time to the joints' limits")
        rows = _rows(self.poses)
        own = np.concatenate([pose.place, pose.quaternion])
        if rows.shape[1] == 3:
            rows = np.concatenate([rows, np.broadcast_to(own[3:], (len(rows), 4))], axis=1)
        if self.times is None:
            rows = np.concatenate([own[None], rows])
            rows = _aligned(rows, first=1)
            steps = _steps(rows)
            if (steps < 1e-9).any():
                raise DefinitionError(f"`Through.poses` {int(np.argmin(steps)) + 1} is where the tool already is")
            knots = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
            curve = Spline(knots=knots, coefficients=quintic_spline(knots, rows))
            return self._timed(curve, float(steps.sum()), _pose(rows[-1]))
        if self.duration is not None:
            raise DefinitionError("`Through` takes either `times` or a `duration`")
        times = np.asarray(self.times, float)
        increasing = times.shape == (len(rows),) and np.isfinite(times).all() and (np.diff(times) > 0).all()
        if len(rows) < 2 or not increasing:
            raise DefinitionError(
                f"`Through.times` must be one for {each_of(len(rows), 'pose')}, at least two, and increase"
            )
        first = _pose(rows[0])
        off = float(np.linalg.norm(first.place - pose.place))
        turned = float(angle_between(first.rotation, pose.rotation))
        if off > NEAR or turned > NEAR:
            raise DefinitionError(
                f"`Through.poses` 1 must be where the tool is when the move begins, {_position_text(pose)}; it is "
                f"{off:.3g} m and {np.rad2deg(turned):.3g} degrees off: put a `Line` to it before"
            )
        rows = _aligned(np.concatenate([own[None], rows[1:]]), first=1)
        span = float(times[-1] - times[0])
        knots = (times - times[0]) / span
        curve = Spline(knots=knots, coefficients=quintic_spline(knots, rows))
        return Bound(curve, linear(span), False, float(_steps(rows).sum()), _pose(rows[-1]))


def _rows(poses: object) -> Array:
    try:
        rows = np.asarray(poses, float)
    except (TypeError, ValueError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[1] not in (3, 7) or not len(rows):
        raise DefinitionError("`Through.poses` must be rows of x, y, z, or of x, y, z, qw, qx, qy, qz, all alike")
    if not np.isfinite(rows).all():
        raise DefinitionError(f"`Through.poses` {int(np.argmax(~np.isfinite(rows).all(axis=1))) + 1} must be finite")
    if rows.shape[1] == 7:
        size = np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
        if (size < 1e-6).any():
            raise DefinitionError(f"`Through.poses` {int(np.argmin(size)) + 1} must have a quaternion of length > 0")
        rows = np.concatenate([rows[:, :3], rows[:, 3:] / size], axis=1)
    return rows


def _aligned(rows: Array, first: int) -> Array:
    """Change signs of quaternions, as q and -q are one orientation, so that neighbours are close."""
    rows = rows.copy()
    for row in range(1, len(rows)):
        if rows[row, 3:] @ rows[row - 1, 3:] < 0:
            rows[row, 3:] *= -1
        cosine = min(float(rows[row, 3:] @ rows[row - 1, 3:]), 1.0)
        if 2 * np.arccos(cosine) > LARGEST_ROTATION:
            raise DefinitionError(
                f"`Through.poses` {row - first + 1} is turned by {np.rad2deg(2 * np.arccos(cosine)):.0f} degrees from "
                f"the one before: at most {np.rad2deg(LARGEST_ROTATION):.0f}; add a pose between them"
            )
    return rows


def _steps(rows: Array) -> Array:
    """Distance between neighbouring poses, m; a rotation counts with a lever arm of 0.1 m."""
    places = np.linalg.norm(np.diff(rows[:, :3], axis=0), axis=1)
    cosines = np.clip(np.sum(rows[1:, 3:] * rows[:-1, 3:], axis=1), -1.0, 1.0)
    return np.hypot(places, 0.1 * 2 * np.arccos(cosines))


def _pose(row: Array) -> Pose:
    return Pose(row[:3], matrix_of(row[3:] / np.linalg.norm(row[3:])))


def _position_text(pose: Pose) -> str:
    return f"[{', '.join(f'{x:.4g}' for x in pose.place)}] m"
