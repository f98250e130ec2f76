"""Read motion tables from CSV files and from ROS messages in JSON."""

from __future__ import annotations

import re
import unicodedata
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, each_of, plain_name, short_repr
from slidax.core.files import parse_json, read_bytes, read_text
from slidax.core.tables import TableFormat, is_number, lines_of, rows_of, table_format

from .table import TIME_UNITS, UNITS, MotionTable, columns_of

ANGLES = ("rad", "deg", "°", "rpm")
"""Prefixes of units of angles and angular rates."""

KINDS = {"": "positions", "velocity": "velocities", "acceleration": "accelerations"}
"""Kind of a column by the suffix of its name, after the dot."""

TITLE = re.compile(
    r"(?P<name>.*?)(?:\.(?P<kind>velocity|acceleration))?\s*(?:\[(?P<unit>.*)\]|\((?P<round>.*)\))?", re.I | re.S
)
"""Column title: name, kind, and a unit in square or round brackets."""

MOST_ROWS = 1_000_000
"""Most rows in a motion table."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    - `index`: index from 0.
    - `factor`: factor that converts its values to SI.
    - `unit`: "s", "rad" or "m", also for a rate such as deg/s; empty if the title has no unit.
    """

    index: int
    factor: float = 1.0
    unit: str = ""


def csv_table(
    source: str | Path, joints: Sequence[str] | None = None, time_unit: str | None = None, units: Sequence[str] = ()
) -> MotionTable:
    """Read a motion table from a CSV file; `Tabulated.from_csv` describes its format.

    - `source`: path of the file, or its text; a string with a line break is taken as text.
    - `joints`: the robot's joint names in its order; by default all columns in their order.
    - `time_unit`: unit of the times; by default the unit in the column title, or s.
    - `units`: units of the robot's joints, rad or m; the columns' units are checked against them.

    Raises DefinitionError, with line and column, if the table is invalid.
    """
    name, form, lines = csv_lines(source, "time,shoulder,elbow")
    header, where = form.titles, f"{name}, line {form.header}"
    columns, time = _columns(header, where)
    names = list(columns["positions"])
    chosen = [names[column] for column in columns_of(name, names, joints)]
    _require_all_or_none(columns, chosen, where)
    _require_units(columns, chosen, joints, units, where)
    if time_unit is not None and time.unit and time.factor != TIME_UNITS[time_unit]:
        raise DefinitionError(
            f"{where}, column `{header[time.index]}` has another unit than `time_unit`, {time_unit}: remove one of "
            "these units"
        )
    values, rows = numbers_in(name, header, lines, MOST_ROWS)
    parts = {
        kind: np.stack(
            [columns[kind][joint].factor * values[:, columns[kind][joint].index] for joint in chosen], axis=1
        )
        for kind in KINDS.values()
        if all(joint in columns[kind] for joint in chosen)
    }
    factor = time.factor if time_unit is None else TIME_UNITS[time_unit]
    unit_is_known = time_unit is not None or bool(time.unit)
    labels = [f"line {line}" for line in rows]
    return MotionTable(
        name, tuple(joints or chosen), labels, factor * values[:, time.index], **parts, unit_is_known=unit_is_known
    )


def csv_lines(source: str | Path, example: str) -> tuple[str, TableFormat, Iterator[tuple[int, list[str]]]]:
    """Return a CSV file's name for messages, its format, and an iterator over the lines below the column titles.

    The iterator yields line number and entries. Blank lines and lines that begin with `#` are skipped.

    - `source`: path of the file, or its text; a string with a line break is taken as text.
    - `example`: an example of the column titles, for a message.

    Raises DefinitionError for an empty file, or one that is not CSV.
    """
    if isinstance(source, str) and ("\n" in source or "\r" in source):
        name, body = "the text", source.encode("utf-8", "surrogatepass")
    else:
        name, body = f"`{Path(source).name}`", read_bytes(Path(source))
    file = BytesIO(body)
    form = table_format(lines_of(file, name), name, example)
    return name, form, rows_of(lines_of(file, name), form, range(len(form.titles)), name)


def numbers_in(
    name: str, header: list[str], lines: Iterator[tuple[int, list[str]]], most: int
) -> tuple[NDArray[np.float64], array[int]]:
    """Return the numbers of a table [rows, columns], and the line number of each row.

    - `name`: name of the table, for messages.
    - `header`: column titles.
    - `lines`: line number and entries of each line.
    - `most`: largest number of rows.

    Raises DefinitionError, with line and column, for an entry that is not a finite number, and for too many rows.
    """
    # Row by row, so that memory never holds the text of all entries.
    numbers, rows = array("d"), array("q")
    for line, row in lines:
        if len(rows) == most:
            raise DefinitionError(f"{name} has more than {most} rows: leave some of them out")
        rows.append(line)
        for column, cell in enumerate(row):
            numbers.append(_number(cell, f"{name}, line {line}, column `{plain_name(header[column])}`"))
    return np.array(numbers, dtype=float).reshape(len(rows), len(header)), rows


def unit_of(title: str) -> tuple[str, str | None]:
    """Split a column's title into its name and its unit in square brackets, or None."""
    parts = re.fullmatch(r"(.*?)\s*(?:\[(.*)\])?", title, re.S)
    assert parts is not None
    return parts[1], None if parts[2] is None else _plain_unit(parts[2])


def _plain_unit(unit: str) -> str:
    """Return a unit in lower case, without `^` and spaces: `rad/s^2` becomes `rad/s2`."""
    return unicodedata.normalize("NFKC", unit).casefold().replace("^", "").replace(" ", "")


def _number(cell: str, where: str) -> float:
    if not is_number(cell):
        reason = f"`{plain_name(cell)}` is not a number" if cell else "there is no number"
        raise DefinitionError(f"{where}: {reason}")
    number = float(cell)
    if not np.isfinite(number):
        raise DefinitionError(f"{where}: `{plain_name(cell)}` is not a finite number")
    return number


def _columns(header: list[str], where: str) -> tuple[dict[str, dict[str, Column]], Column]:
    """Return the columns of positions, velocities and accelerations by joint, and the time column."""
    columns: dict[str, dict[str, Column]] = {kind: {} for kind in ("time", *KINDS.values())}
    for index, title in enumerate(header):
        joint, suffix, unit = _parts_of(title)
        if not joint:
            raise DefinitionError(f"{where}: column {index + 1} has no name")
        kind = "time" if joint.casefold() == "time" and not suffix else KINDS[suffix]
        known = TIME_UNITS if kind == "time" else UNITS[kind]
        key = None if unit is None else _plain_unit(unit)
        if key is not None and key not in known:
            raise DefinitionError(f"{where}, column `{title}`: the unit must be one of {', '.join(known)}")
        si = "" if key is None else "s" if kind == "time" else "rad" if key.startswith(ANGLES) else "m"
        joint = "time" if kind == "time" else joint
        if joint in columns[kind]:
            raise DefinitionError(f"{where}: the column `{title}` occurs twice")
        columns[kind][joint] = Column(index, 1.0 if key is None else known[key], si)
    if not columns["time"]:
        near = next((title for title in header if title.lower() in ("t", "times", "seconds", "stamp")), None)
        hint = f"; is `{near}` the time? Then rename it to `time`" if near else ""
        raise DefinitionError(f"{where}: there must be a column `time` [s]{hint}")
    if not columns["positions"]:
        raise DefinitionError(
            f"{where}: there must be a column with the positions of each joint, in addition to `time`"
        )
    for suffix, kind in KINDS.items():
        for joint in columns[kind]:
            if joint not in columns["positions"]:
                raise DefinitionError(f"{where}: there is `{joint}.{suffix}`, but no column `{joint}` with positions")
    return columns, columns["time"]["time"]


def _parts_of(title: str) -> tuple[str, str, str | None]:
    """Split a title into name, suffix and unit; text in round brackets counts as a unit only if it is a known unit."""
    matched = TITLE.fullmatch(title)
    assert matched is not None
    unit, other = matched["unit"], matched["round"]
    if other is not None:
        if other.strip().casefold() not in {unit for units in (TIME_UNITS, *UNITS.values()) for unit in units}:
            return title, "", None
        unit = other
    return matched["name"].strip(), (matched["kind"] or "").lower(), unit


def _require_all_or_none(columns: dict[str, dict[str, Column]], chosen: list[str], where: str) -> None:
    """Raise DefinitionError if only some of the joints have velocities, or only some have accelerations."""
    for suffix, kind in KINDS.items():
        absent = [joint for joint in chosen if joint not in columns[kind]]
        if absent and len(absent) < len(chosen):
            raise DefinitionError(
                f"{where}: the column `{absent[0]}.{suffix}` is missing: give {kind} for all joints, or for none"
            )


def _require_units(
    columns: dict[str, dict[str, Column]],
    chosen: list[str],
    joints: Sequence[str] | None,
    units: Sequence[str],
    where: str,
) -> None:
    """Raise DefinitionError if a unit does not fit its joint, or a rate has no unit but its position is not in SI."""
    if units and len(units) != len(chosen):
        raise DefinitionError(f"{where}: there must be one unit for {each_of(len(chosen), 'joint')}; got {len(units)}")
    for index, name in enumerate(chosen):
        position = columns["positions"][name]
        for suffix, kind in KINDS.items():
            column = columns[kind].get(name)
            if column is None:
                continue
            title = f"{name}.{suffix}" if suffix else name
            if not column.unit and position.factor != 1.0:
                raise DefinitionError(
                    f"{where}: the column `{name}` is in another unit than {position.unit}, and `{title}` has no unit: "
                    f"write its unit in brackets, such as `{title} [{list(UNITS[kind])[position.unit == 'm']}]`"
                )
            if units and column.unit not in ("", units[index]):
                kind = "revolute" if units[index] == "rad" else "prismatic"
                joint = joints[index] if joints else name
                raise DefinitionError(f"{where}: the column `{title}` is in {column.unit}, but `{joint}` is {kind}")
            if column.unit and position.unit and column.unit != position.unit:
                raise DefinitionError(
                    f"{where}: the column `{title}` is in {column.unit}, but `{name}` in {position.unit}"
                )


MOST_CHARACTERS = 16_000_000
"""Most characters in the JSON text of a ROS message."""

NANOSECONDS = {"sec": "nanosec", "secs": "nsecs"}
"""Names of seconds and nanoseconds in ROS 2 and in ROS 1."""

WRAPPERS = ("trajectory", "joint_trajectory")
"""Fields of larger messages that hold a joint trajectory."""


def joint_trajectory_table(
    source: str | Path | Mapping[str, Any], joints: Sequence[str] | None = None, time_unit: str | None = None
) -> MotionTable:
    """Read the table in a trajectory_msgs/JointTrajectory; arguments as in `Tabulated.from_joint_trajectory`.

    Raises DefinitionError, with point and joint, if the message is invalid.
    """
    if isinstance(source, Mapping):
        name, message = "the message", source
    else:
        if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith(("{", "[")):
            name, text = "the text", source.removeprefix("\ufeff")
        else:
            name, text = f"`{Path(source).name}`", read_text(Path(source))
        if len(text) > MOST_CHARACTERS:
            raise DefinitionError(f"{name} has {len(text)} characters; the most is {MOST_CHARACTERS}")
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
    # A time in seconds and nanoseconds has a known unit.
    unit_is_known = time_unit is not None or any(isinstance(time, Mapping) for time in durations)
    order = tuple(joints or names)
    return MotionTable(name, order, rows, np.array(times, dtype=float), **parts, unit_is_known=unit_is_known)


def _parts(message: Mapping[str, Any], name: str) -> tuple[tuple[str, ...], list[Any]]:
    for field in ("joint_names", "points"):
        if field not in message:
            inside = next((wrapper for wrapper in WRAPPERS if wrapper in message), None)
            hint = f"; it has `{inside}`: pass that field alone" if inside else ""
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
                raise DefinitionError(
                    f"{where}: `{field}` of `{joints[joint]}` must be a number; got {short_repr(number)}"
                )
            values[row, joint] = number
    return values


def _seconds(duration: Any, where: str, unit: str | None) -> float:
    """Return a ROS duration in seconds."""
    if isinstance(duration, (int, float)) and not isinstance(duration, bool):
        return float(duration) * TIME_UNITS[unit or "s"]
    if isinstance(duration, Mapping):
        if unit is not None:
            raise DefinitionError(f"{where}: `time_from_start` already has a unit: leave out `time_unit`")
        for seconds, nanoseconds in NANOSECONDS.items():
            parts = (duration.get(seconds), duration.get(nanoseconds, 0))
            if set(duration) <= {seconds, nanoseconds} and all(
                isinstance(part, (int, float)) and not isinstance(part, bool) for part in parts
            ):
                return float(parts[0] + parts[1] * 1e-9)
    rule = "must be {sec, nanosec}, {secs, nsecs} or a number of seconds"
    raise DefinitionError(f"{where}: `time_from_start` {rule}; got {short_repr(duration)}")
