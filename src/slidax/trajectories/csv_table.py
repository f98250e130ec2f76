"""A table from a CSV file."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError

from .source_text import source_text
from .table import Table

KINDS = {"": "positions", "velocity": "velocities", "acceleration": "accelerations"}
"""What stands after the dot in the name of a column, and what the column then is."""

UNITS = {
    "time": ("s",),
    "": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s²", "rad/s^2", "rad/s2", "m/s²", "m/s^2", "m/s2"),
}


def csv_table(source: str | Path) -> Table:
    """The table in a CSV file: see `Tabulated.from_csv` for its form.

    - `source`: path, or the text itself, which has a line break in it.

    Raises DefinitionError, with line and column, if it has not that form.
    """
    name, text = source_text(source, is_text=lambda text: "\n" in text or "\r" in text)
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    try:
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise DefinitionError(f"{name}, line {reader.line_num}: {error}") from None
    lines = [(line, row) for line, row in lines if any(row) and not row[0].startswith("#")]
    if not lines:
        raise DefinitionError(f"{name} is empty: the first line must name the columns, such as `time,shoulder,elbow`")
    (header_line, header), rows = lines[0], lines[1:]
    columns = _columns(header, f"{name}, line {header_line}")
    values = np.empty((len(rows), len(header)))
    for index, (line, row) in enumerate(rows):
        if len(row) != len(header):
            raise DefinitionError(
                f"{name}, line {line}: {len(row)} entries, but there are {len(header)} columns "
                "(a decimal comma counts as a comma)"
            )
        for column, cell in enumerate(row):
            values[index, column] = _number(cell, f"{name}, line {line}, column `{header[column]}`")
    joints = list(columns["positions"])
    parts = {kind: values[:, [columns[kind][joint] for joint in joints]] for kind in KINDS.values() if columns[kind]}
    return Table(name, tuple(joints), [f"line {line}" for line, _ in rows], values[:, columns["time"]["time"]], **parts)


def _number(cell: str, where: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        what = f"`{cell}` is not a number" if cell else "there is no number"
        raise DefinitionError(f"{where}: {what}") from None
    if not np.isfinite(number):
        raise DefinitionError(f"{where}: `{cell}` is not a finite number")
    return number


def _columns(header: list[str], where: str) -> dict[str, dict[str, int]]:
    """Of time, positions, velocities and accelerations, the column of each joint."""
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        raise DefinitionError(f"{where}: columns must be separated by commas")
    if all(re.fullmatch(r"[-+.\deE]+", title) for title in header):
        raise DefinitionError(f"{where}: the first line must name the columns, such as `time,shoulder,elbow`")
    found: dict[str, dict[str, int]] = {kind: {} for kind in ("time", *KINDS.values())}
    for column, title in enumerate(header):
        matched = re.fullmatch(r"(?P<name>.*?)(?:\.(?P<kind>velocity|acceleration))?(?:\s*\[(?P<unit>.*)\])?", title)
        assert matched is not None
        joint, suffix, unit = matched["name"], matched["kind"] or "", matched["unit"]
        if not joint:
            raise DefinitionError(f"{where}: column {column + 1} has no name")
        is_time = joint == "time" and not suffix
        allowed = UNITS["time" if is_time else suffix]
        if unit is not None and unit not in allowed:
            words = " or ".join(allowed[:2])
            raise DefinitionError(f"{where}, column `{title}`: must be in {words}; convert the column and its title")
        places = found["time" if is_time else KINDS[suffix]]
        if joint in places:
            raise DefinitionError(f"{where}: the column `{title}` is there twice")
        places[joint] = column
    if not found["time"]:
        near = next((title for title in header if title.lower() in ("t", "time", "times", "seconds", "stamp")), None)
        hint = f"; is it `{near}`? Then call it `time`" if near else ""
        raise DefinitionError(f"{where}: there must be a column `time` [s]{hint}")
    if not found["positions"]:
        raise DefinitionError(f"{where}: there must be a column per joint besides `time`, with its positions")
    _require_all_or_none(found, where)
    return found


def _require_all_or_none(found: dict[str, dict[str, int]], where: str) -> None:
    """Velocities, and accelerations, for all joints or for none."""
    for suffix, kind in KINDS.items():
        for joint in found[kind]:
            if joint not in found["positions"]:
                raise DefinitionError(f"{where}: there is `{joint}.{suffix}`, but no column `{joint}` with positions")
        if found[kind]:
            for joint in found["positions"]:
                if joint not in found[kind]:
                    raise DefinitionError(
                        f"{where}: the column `{joint}.{suffix}` is missing: give {kind} for all joints, or for none"
                    )
