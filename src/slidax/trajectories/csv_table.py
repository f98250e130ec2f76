"""Tables of motions from CSV files."""

from __future__ import annotations

import re
import unicodedata
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError, plain
from slidax._files import read_bytes
from slidax._tables import Form, form_of, is_number, lines_of, rows_of

from .table import TIME_UNITS, UNITS, Table, columns_of

ANGLES = ("rad", "deg", "°", "rpm")
"""Beginnings of units of angles and of their rates."""

KINDS = {"": "positions", "velocity": "velocities", "acceleration": "accelerations"}
"""Kind of a column by the suffix after the dot in its name."""

TITLE = re.compile(
    r"(?P<name>.*?)(?:\.(?P<kind>velocity|acceleration))?\s*(?:\[(?P<unit>.*)\]|\((?P<round>.*)\))?", re.I | re.S
)
"""Of a column."""

MOST_ROWS = 1_000_000
"""Of a motion."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    - `place`: index from 0.
    - `factor`: its unit in SI.
    - `unit`: rad or m; empty if the title has none.
    """

    place: int
    factor: float = 1.0
    unit: str = ""


def csv_table(
    source: str | Path, joints: Sequence[str] | None = None, time_unit: str | None = None, units: Sequence[str] = ()
) -> Table:
    """Read the table in a CSV file, in the form of `Tabulated.from_csv`.

    - `source`: path, or the text itself, which has a line break in it.
    - `joints`: the robot's joint names in its order; by default all columns in their order.
    - `time_unit`: unit of the times; by default the title's, or s.
    - `units`: of the robot's joints, rad or m, for a check.

    Raises DefinitionError, with line and column, for another form.
    """
    name, form, lines = csv_lines(source, "time,shoulder,elbow")
    header, where = form.titles, f"{name}, line {form.header}"
    columns, time = _columns(header, where)
    names = list(columns["positions"])
    chosen = [names[place] for place in columns_of(name, names, joints)]
    _require_all_or_none(columns, chosen, where)
    _require_units(columns, chosen, joints, units, where)
    if time_unit is not None and time.unit and time.factor != TIME_UNITS[time_unit]:
        raise DefinitionError(f"{where}, column `{header[time.place]}`: the times cannot also be in {time_unit}")
    values, rows = numbers_in(name, header, lines, MOST_ROWS)
    parts = {
        kind: np.stack(
            [columns[kind][joint].factor * values[:, columns[kind][joint].place] for joint in chosen], axis=1
        )
        for kind in KINDS.values()
        if all(joint in columns[kind] for joint in chosen)
    }
    factor = time.factor if time_unit is None else TIME_UNITS[time_unit]
    unit_is_known = time_unit is not None or bool(time.unit)
    lines_of = [f"line {line}" for line in rows]
    return Table(
        name, tuple(joints or chosen), lines_of, factor * values[:, time.place], **parts, unit_is_known=unit_is_known
    )


def csv_lines(source: str | Path, example: str) -> tuple[str, Form, Iterator[tuple[int, list[str]]]]:
    """Return a CSV file's name for messages, its form, and numbers and entries of its other lines.

    Blank lines and lines that begin with `#` are skipped.

    - `source`: path, or the text itself, which has a line break in it.
    - `example`: an example of the first line, for a message.

    Raises DefinitionError for an empty file, or one that is no CSV.
    """
    if isinstance(source, str) and ("\n" in source or "\r" in source):
        name, body = "the text", source.encode("utf-8", "surrogatepass")
    else:
        name, body = f"`{Path(source).name}`", read_bytes(Path(source))
    file = BytesIO(body)
    form = form_of(lines_of(file, name), name, example)
    return name, form, rows_of(lines_of(file, name), form, range(len(form.titles)), name)


def numbers_in(
    name: str, header: list[str], lines: Iterator[tuple[int, list[str]]], most: int
) -> tuple[NDArray[np.float64], array[int]]:
    """Return the numbers of a table [rows, columns], and the line of each row.

    - `name`: of the table, for messages.
    - `lines`: entries of each line, with its number.
    - `most`: largest number of rows.

    Raises DefinitionError, with line and column, for an entry that is no finite number, and for too many rows.
    """
    # Row by row, so that the texts of all entries are never in memory together.
    numbers, rows = array("d"), array("q")
    for line, row in lines:
        if len(rows) == most:
            raise DefinitionError(f"{name} has more than {most} rows: leave some of them out")
        rows.append(line)
        for column, cell in enumerate(row):
            numbers.append(_number(cell, f"{name}, line {line}, column `{plain(header[column])}`"))
    return np.array(numbers, dtype=float).reshape(len(rows), len(header)), rows


def unit_of(title: str) -> tuple[str, str | None]:
    """Split a column's title into its name and its unit in brackets; None without."""
    parts = re.fullmatch(r"(.*?)\s*(?:\[(.*)\])?", title, re.S)
    assert parts is not None
    return parts[1], None if parts[2] is None else _plain_unit(parts[2])


def _plain_unit(unit: str) -> str:
    """A unit in small letters without powers and spaces: `rad/s^2` becomes `rad/s2`."""
    return unicodedata.normalize("NFKC", unit).casefold().replace("^", "").replace(" ", "")


def _number(cell: str, where: str) -> float:
    if not is_number(cell):
        reason = f"`{plain(cell)}` is not a number" if cell else "there is no number"
        raise DefinitionError(f"{where}: {reason}")
    number = float(cell)
    if not np.isfinite(number):
        raise DefinitionError(f"{where}: `{plain(cell)}` is not a finite number")
    return number


def _columns(header: list[str], where: str) -> tuple[dict[str, dict[str, Column]], Column]:
    """Each joint's columns of positions, velocities and accelerations; and the time's column."""
    columns: dict[str, dict[str, Column]] = {kind: {} for kind in ("time", *KINDS.values())}
    for place, title in enumerate(header):
        joint, suffix, unit = _parts_of(title)
        if not joint:
            raise DefinitionError(f"{where}: column {place + 1} has no name")
        kind = "time" if joint.casefold() == "time" and not suffix else KINDS[suffix]
        known = TIME_UNITS if kind == "time" else UNITS[kind]
        key = None if unit is None else _plain_unit(unit)
        if key is not None and key not in known:
            raise DefinitionError(f"{where}, column `{title}`: the unit must be one of {', '.join(known)}")
        si = "" if key is None else "s" if kind == "time" else "rad" if key.startswith(ANGLES) else "m"
        joint = "time" if kind == "time" else joint
        if joint in columns[kind]:
            raise DefinitionError(f"{where}: the column `{title}` is there twice")
        columns[kind][joint] = Column(place, 1.0 if key is None else known[key], si)
    if not columns["time"]:
        near = next((title for title in header if title.lower() in ("t", "times", "seconds", "stamp")), None)
        hint = f"; is it `{near}`? Then call it `time`" if near else ""
        raise DefinitionError(f"{where}: there must be a column `time` [s]{hint}")
    if not columns["positions"]:
        raise DefinitionError(f"{where}: there must be a column per joint besides `time`, with its positions")
    for suffix, kind in KINDS.items():
        for joint in columns[kind]:
            if joint not in columns["positions"]:
                raise DefinitionError(f"{where}: there is `{joint}.{suffix}`, but no column `{joint}` with positions")
    return columns, columns["time"]["time"]


def _parts_of(title: str) -> tuple[str, str, str | None]:
    """Name, kind and unit of a column. Text in round brackets is a unit only if it is a known one."""
    matched = TITLE.fullmatch(title)
    assert matched is not None
    unit, other = matched["unit"], matched["round"]
    if other is not None:
        if other.strip().casefold() not in {unit for units in (TIME_UNITS, *UNITS.values()) for unit in units}:
            return title, "", None
        unit = other
    return matched["name"].strip(), (matched["kind"] or "").lower(), unit


def _require_all_or_none(columns: dict[str, dict[str, Column]], chosen: list[str], where: str) -> None:
    """Require velocities, and accelerations, for all joints or for none."""
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
    """Raise DefinitionError if a unit does not fit its joint, or a derivative lacks one that its position has."""
    for place, name in enumerate(chosen):
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
            if units and column.unit not in ("", units[place]):
                verb = "turns" if units[place] == "rad" else "slides"
                joint = joints[place] if joints else name
                raise DefinitionError(f"{where}: the column of `{title}` is in {column.unit}, but `{joint}` {verb}")
            if column.unit and position.unit and column.unit != position.unit:
                raise DefinitionError(
                    f"{where}: the column of `{title}` is in {column.unit}, but that of `{name}` in {position.unit}"
                )
