"""A motion through the rows of a table of joint positions, from a CSV file, a ROS message, or arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from slidax.core.errors import DefinitionError, as_array, float_array, short_repr
from slidax.core.parameter import piece

from .limits import MotionLimits
from .splines import cubic_hermite, quintic_hermite, quintic_spline
from .table import BEYOND_ARMS, MotionTable, at_rest_outside, require_no_jump, require_within, warn_of_slow_times
from .table_files import csv_table, joint_trajectory_table
from .trajectory import AbstractPiecewisePolynomial

TimeUnit = Literal["s", "ms", "us", "ns"]
"""Unit of the times in a table."""


class Tabulated(AbstractPiecewisePolynomial):
    """A motion through the rows of a table at their times; at rest before the first row and after the last.

    Between two rows the motion is

    - a cubic, if the table has velocities: continuous velocity, as in ROS's joint trajectory controller;
    - a quintic, if it also has accelerations: continuous acceleration, as in that controller;
    - a piece of the quintic spline at rest at both ends (`MinimumJerk`), if it has positions only: continuous
      acceleration. ROS takes straight lines there, whose velocity jumps at every row.

    Velocities must be zero in the first and the last row. A table of positions only must not have a velocity jump, from
    one row to the next, between two parts of steady motion. The standstill before the first row and after the last one
    counts as such a part. If `acceleration` is set, this limit replaces the check for jumps. Otherwise the limit is
    200 rad/s² (or m/s²), more than any arm reaches.

    Construct one by `Tabulated.from_csv`, `Tabulated.from_joint_trajectory` or `Tabulated.through`.
    """

    joint_names: tuple[str, ...] = piece("joint names in the data", default=(), static=True)

    @staticmethod
    def from_csv(
        source: str | Path,
        *,
        joints: Sequence[str] | None = None,
        units: Sequence[str] = (),
        time_unit: TimeUnit | None = None,
        start: float | None = None,
        lower: object = -np.inf,
        upper: object = np.inf,
        velocity: object = np.inf,
        acceleration: object = None,
    ) -> Tabulated:
        """Read the motion in a CSV file.

        The first line names the columns: `time`, one column per joint, in any order, optionally one `NAME.velocity` per
        joint, and with these optionally one `NAME.acceleration`. Units are SI unless another one is given in brackets:
        `elbow [deg]`, `time [ms]`. Case, spaces and punctuation of the names do not matter.

        - `source`: path of the file, or its text; a string with a line break is taken as text.
        - `joints`: the robot's joint names in its order, `robot.joint_names`; by default the order of the columns.
          Columns of other joints are dropped with a DefinitionWarning.
        - `units`: units of the robot's joints, `robot.joint_units`; the columns' units are checked against them.
        - `time_unit`: unit of the times; by default the unit in the column title, or s.
        - `start`: time of the first row [s]; all times are shifted to it. By default the times are those of the file.
        - `lower`, `upper`: position limits, [n] or one number, rad or m.
        - `velocity`, `acceleration`: limits, [n] or one number, rad/s and rad/s², or m/s and m/s².

        Raises DefinitionError, with line and column, if the table is invalid, its velocity jumps or it exceeds a limit.
        """
        table = csv_table(source, joints, _time_unit(time_unit), units)
        return _interpolated(table, start, MotionLimits(lower, upper, velocity, acceleration))

    @staticmethod
    def from_joint_trajectory(
        source: str | Path | Mapping[str, Any],
        *,
        joints: Sequence[str] | None = None,
        time_unit: TimeUnit | None = None,
        start: float | None = None,
        lower: object = -np.inf,
        upper: object = np.inf,
        velocity: object = np.inf,
        acceleration: object = None,
    ) -> Tabulated:
        """Read the motion in a ROS message, trajectory_msgs/JointTrajectory, as JSON.

        `time_from_start` may be `{sec, nanosec}` (ROS 2), `{secs, nsecs}` (ROS 1) or a number of seconds. `effort` and
        `header` are ignored.

        - `source`: path of a JSON file; or its text, which begins with a brace; or the message as a mapping.
        - `time_unit`: unit of times that are plain numbers; s by default.
        - `joints`, `start`, `lower`, `upper`, `velocity`, `acceleration`: as in `from_csv`.

        Raises DefinitionError, with point and joint, if the message is invalid, its velocity jumps or it exceeds a
        limit.
        """
        limits = MotionLimits(lower, upper, velocity, acceleration)
        return _interpolated(joint_trajectory_table(source, joints, _time_unit(time_unit)), start, limits)

    @staticmethod
    def through(
        times: object,
        positions: object,
        velocities: object = None,
        accelerations: object = None,
        *,
        lower: object = -np.inf,
        upper: object = np.inf,
        velocity: object = np.inf,
        acceleration: object = None,
    ) -> Tabulated:
        """Return the motion through the rows of arrays, such as those of a log.

        - `times`: [k], s, increasing.
        - `positions`: [k n], rad or m.
        - `velocities`, `accelerations`: [k n], rad/s and rad/s², or m/s and m/s²; or None.
        - `lower`, `upper`, `velocity`, `acceleration`: limits as in `from_csv`.

        Raises DefinitionError, with row and joint, if the table is invalid, its velocity jumps or it exceeds a limit.
        """
        t, q = float_array("times", times), float_array("positions", positions)
        optional = {"velocities": velocities, "accelerations": accelerations}
        more = {name: float_array(name, value) for name, value in optional.items() if value is not None}
        if t.ndim != 1 or q.ndim != 2 or any(rows.shape != (len(t), q.shape[1]) for rows in (q, *more.values())):
            shapes = [list(q.shape), *(list(rows.shape) for rows in more.values())]
            raise DefinitionError(
                f"`Tabulated` needs one row per time and one column per joint; got shapes {shapes} for {len(t)} times"
            )
        table = MotionTable(
            "the table",
            (),
            [f"row {row + 1}" for row in range(len(t))],
            t,
            q,
            more.get("velocities"),
            more.get("accelerations"),
            True,
        )
        return _interpolated(table, None, MotionLimits(lower, upper, velocity, acceleration))


def _time_unit(unit: str | None) -> str | None:
    if unit is not None and unit not in get_args(TimeUnit):
        raise DefinitionError(f"`time_unit` must be one of {', '.join(get_args(TimeUnit))}; got {short_repr(unit)}")
    return unit


def _interpolated(table: MotionTable, start: float | None, limits: MotionLimits) -> Tabulated:
    table = at_rest_outside(table.shifted(start))
    if table.velocities is None:
        coefficients = quintic_spline(table.times, table.positions)
    elif table.accelerations is None:
        coefficients = cubic_hermite(table.times, table.positions, table.velocities)
    else:
        coefficients = quintic_hermite(table.times, table.positions, table.velocities, table.accelerations)
    motion = Tabulated(as_array(table.times), as_array(coefficients), table.joints)
    warn_of_slow_times(motion, table)
    if limits.acceleration is None:
        require_no_jump(motion, table)
        limits = replace(limits, acceleration=BEYOND_ARMS)
    require_within(motion, table, limits)
    return motion
