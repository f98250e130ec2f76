"""Tables of motions from ROS messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError, each_of, shown
from slidax._files import parse_json, read_text

from .table import TIME_UNITS, Table, columns_of

MOST_CHARACTERS = 16_000_000
"""Of a message."""

NANOSECONDS = {"sec": "nanosec", "secs": "nsecs"}
"""Seconds and their billionths as ROS 2 and ROS 1 call them."""

WRAPPERS = ("trajectory", "joint_trajectory")
"""Fields of larger messages that hold a joint trajectory."""


def joint_trajectory_table(
    source: str | Path | Mapping[str, Any], joints: Sequence[str] | None = None, time_unit: str | None = None
) -> Table:
    """Read the table in a trajectory_msgs/JointTrajectory; arguments as in `Tabulated.from_joint_trajectory`.

    Raises DefinitionError, with point and joint, for another form.
    """
    if isinstance(source, Mapping):
        name, message = "the message", source
    else:
        if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith(("{", "[")):
            name, text = "the text", source.removeprefix("\ufeff")
        else:
            name, text = f"`{Path(source).name}`", read_text(Path(source))
        if len(text) > MOST_CHARACTERS:
            raise DefinitionError(f"{name} has {len(text)} characters, and at most {MOST_CHARACTERS} are read")
        message = parse_json(text, name)
        if not isinstance(message, dict):
            raise DefinitionError(f"{name} must be a JSON object with `joint_names` and `points`")
    names, points = _parts(message, name)
    columns = columns_of(name, names, joints)
    rows = [f"points[{index}]" for index in range(len(points))]
    for row, point in zip(rows, points, strict=True):
        if not isinstance(point, Mapping):
            raise DefinitionError(f"{name}, {row}: must be a mapping with `positions` and `time_from_start`")
    durations = [point.get("time_from_start") for point in points]
    times = [_seconds(time, f"{name}, {row}", time_unit) for row, time in zip(rows, durations, strict=True)]
    parts = {
        field: _numbers(points, field, names, name)[:, columns]
        for field in ("positions", "velocities", "accelerations")
        if field == "positions" or _has(points, field, name)
    }
    # A message in parts of its own says what they are.
    unit_is_known = time_unit is not None or any(isinstance(time, Mapping) for time in durations)
    order = tuple(joints or names)
    return Table(name, order, rows, np.array(times, dtype=float), **parts, unit_is_known=unit_is_known)


def _parts(message: Mapping[str, Any], name: str) -> tuple[tuple[str, ...], list[Any]]:
    for field in ("joint_names", "points"):
        if field not in message:
            inside = next((wrapper for wrapper in WRAPPERS if wrapper in message), None)
            hint = f"; it has `{inside}`: give that" if inside else ""
            raise DefinitionError(f"{name} has no `{field}`: it must be a trajectory_msgs/JointTrajectory{hint}")
    joints, points = message["joint_names"], message["points"]
    if not isinstance(joints, (list, tuple)) or not joints or not all(isinstance(joint, str) for joint in joints):
        raise DefinitionError(f"{name}: `joint_names` must be a list of names")
    if not isinstance(points, (list, tuple)):
        raise DefinitionError(f"{name}: `points` must be a list")
    return tuple(joints), list(points)


def _has(points: list[Any], field: str, name: str) -> bool:
    """True if all points have the field, False if none has it; an empty list counts as none, as in ROS."""
    present = [bool(point.get(field)) for point in points]
    if any(present) and not all(present):
        with_it, without = present.index(True), present.index(False)
        raise DefinitionError(
            f"{name}: points[{with_it}] has `{field}`, but points[{without}] has not: give them for all, or for none"
        )
    return any(present)


def _numbers(points: list[Any], field: str, joints: tuple[str, ...], name: str) -> NDArray[np.float64]:
    values = np.empty((len(points), len(joints)))
    for row, point in enumerate(points):
        row_values = point.get(field)
        where = f"{name}, points[{row}]"
        if not isinstance(row_values, (list, tuple)) or len(row_values) != len(joints):
            what = f"{len(row_values)} of them" if isinstance(row_values, (list, tuple)) else "none"
            raise DefinitionError(
                f"{where}: `{field}` must have one number for {each_of(len(joints), 'joint')}; got {what}"
            )
        for joint, number in enumerate(row_values):
            if isinstance(number, bool) or not isinstance(number, (int, float)):
                raise DefinitionError(f"{where}: `{field}` of `{joints[joint]}` must be a number; got {shown(number)}")
            values[row, joint] = number
    return values


def _seconds(duration: Any, where: str, unit: str | None) -> float:
    """A ROS duration in seconds."""
    if isinstance(duration, (int, float)) and not isinstance(duration, bool):
        return float(duration) * TIME_UNITS[unit or "s"]
    if isinstance(duration, Mapping):
        if unit is not None:
            raise DefinitionError(f"{where}: `time_from_start` says its own unit, so that `time_unit` cannot be given")
        for seconds, billionths in NANOSECONDS.items():
            parts = (duration.get(seconds), duration.get(billionths, 0))
            if set(duration) <= {seconds, billionths} and all(
                isinstance(part, (int, float)) and not isinstance(part, bool) for part in parts
            ):
                return float(parts[0] + parts[1] * 1e-9)
    rule = "must be {sec, nanosec}, {secs, nsecs} or a number of seconds"
    raise DefinitionError(f"{where}: `time_from_start` {rule}; got {shown(duration)}")
