"""A row of a study as a scenario of its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError
from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.uncertainty.leaf import Array

from .store import ROWS, read_rows
from .stored import digest_of, read_identity, study_of_rows
from .table import Columns
from .task import Task

TASK = ("scenario", "uncertain", "varied", "engine")
"""Keys of `study.json` from which rows are computed."""


def scenario_of_row(folder: str | Path, row: int) -> ScenarioDescription:
    """The scenario of one row, which `slidax run` replays, bit for bit on the same machine.

    - `folder`: with `study.json` and `rows.parquet`, as a study writes them.
    - `row`: its number.

    Raises DefinitionError if there is no such row.
    """
    rows, identity = read_rows(folder), read_identity(Path(folder))
    if "row" not in rows or any(key not in identity for key in TASK):
        raise DefinitionError(
            f"the folder `{folder}` is not of a study: `rows.parquet` has no column `row`, or `study.json` no sets"
        )
    if study_of_rows(Path(folder) / ROWS) != digest_of(identity):
        raise DefinitionError(
            f"`{Path(folder) / ROWS}` has rows of another study than `study.json` says: "
            f"`slidax study FILE --out {folder} --resume` writes them again"
        )
    if not 0 <= row < len(rows["row"]):
        raise DefinitionError(f"there are rows 0 to {len(rows['row']) - 1}; got {row}")
    family = Task(json.dumps({key: identity[key] for key in TASK})).cases().family
    return family.case({path: _value(rows, path, row) for path in family.space.sets})


def _value(rows: Columns, path: str, row: int) -> Array:
    """One number, or those of the columns `path[0]`, `path[1]`, ..."""
    if path in rows:
        return np.asarray(rows[path][row])
    places = {name: name[len(path) + 1 : -1] for name in rows if name.startswith(f"{path}[")}
    indices = {name: tuple(int(k) for k in place.split(",")) for name, place in places.items()}
    array = np.zeros(np.max(list(indices.values()), axis=0) + 1)
    for name, index in indices.items():
        array[index] = rows[name][row]
    return array
