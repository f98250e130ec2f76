"""Study files, the rows of a study as a data frame, and a row as a scenario."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Union

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from slidax.core.errors import DefinitionError, plain_name
from slidax.scenarios.scenario import ScenarioDescription
from slidax.scenarios.uncertain_values import Array
from slidax.scenarios.yaml_text import read_yaml_file, require_readable, validation_error
from slidax.simulation.run import Kind, data_frame

from .cases import COLUMNS, Columns, StudyTask
from .compare import Compare
from .falsify import Falsify
from .monte_carlo import MonteCarlo
from .sensitivity import Sensitivity
from .store import ROWS, digest_of, read_identity, read_rows, study_of_rows
from .study import AbstractStudy
from .sweep import Sweep
from .tune import Tune

KINDS: tuple[type[AbstractStudy], ...] = (MonteCarlo, Sweep, Falsify, Sensitivity, Tune, Compare)
"""The classes of the six kinds of studies."""

if TYPE_CHECKING:
    AnyStudy = AbstractStudy
else:
    AnyStudy = Annotated[Union[KINDS], Field(discriminator="study")] if len(KINDS) > 1 else KINDS[0]  # noqa: UP007


def read_study(path: str | Path, changes: dict[str, Any] | None = None) -> AbstractStudy:
    """Read a study from a YAML file.

    - `path`: the file; scenarios and files that it names are relative to its folder.
    - `changes`: new values of the study's fields by name, such as `{"runs": 100}`.

    Raises DefinitionError with the path of the first invalid field.
    """
    path = Path(path)
    return study_of(read_yaml_file(path, "the study file"), changes, folder=path.parent)


def study_of(data: Any, changes: dict[str, Any] | None = None, *, folder: str | Path = Path()) -> AbstractStudy:
    """Return the study that a mapping describes.

    - `data`: the fields of a study file, as nested mappings, lists and values.
    - `changes`: as in `read_study`.
    - `folder`: folder to which file names are relative.

    Raises DefinitionError with the path of the first invalid field.
    """
    if not isinstance(data, dict):
        raise DefinitionError("a study must be a mapping with the keys study, scenario, uncertainty, ...")
    require_readable(data)
    added = set(changes or {}) - set(data)
    data = {**data, **(changes or {})}
    scenario = data.get("scenario")
    if isinstance(scenario, str) and Path(scenario).suffix in (".yaml", ".yml"):
        data["scenario"] = str(Path(folder, scenario))
    try:
        result: AbstractStudy = TypeAdapter(AnyStudy).validate_python(data, context={"folder": Path(folder)})
    except ValidationError as error:
        for mistake in error.errors():
            name = mistake.get("ctx", {}).get("key")
            if mistake["type"] == "unknown_key" and name in added:
                kind = plain_name(str(data.get("study")))
                raise DefinitionError(f"a study of the kind `{kind}` has no `{name}` to set: leave it out") from None
        raise validation_error(error, data) from None
    return result


TASK = ("scenario", "uncertain", "varied", "engine")
"""Keys of `study.json` that determine the rows."""


def scenario_of_row(folder: str | Path, row: int) -> ScenarioDescription:
    """Return the scenario that a study ran for a row; `slidax run` replays it, bit for bit on the same machine.

    - `folder`: a study's folder with `study.json` and `rows.parquet`.
    - `row`: number of the row.

    Raises DefinitionError if the folder has no complete study, or the study has no such row.
    """
    rows, identity = read_rows(folder), read_identity(Path(folder))
    if "row" not in rows or any(key not in identity for key in TASK):
        raise DefinitionError(
            f"the folder `{folder}` is not from a study: `rows.parquet` has no column `row`, or `study.json` "
            "no sets of uncertain values; give the folder of `slidax study FILE --out DIR`"
        )
    if study_of_rows(Path(folder) / ROWS) != digest_of(identity):
        raise DefinitionError(
            f"the rows in `{Path(folder) / ROWS}` belong to another study than `study.json`: "
            f"`slidax study FILE --out {folder} --resume` writes them again"
        )
    if not 0 <= row < len(rows["row"]):
        raise DefinitionError(f"the study has the rows 0 to {len(rows['row']) - 1}; got {row}")
    family = StudyTask(json.dumps({key: identity[key] for key in TASK})).cases().family
    return family.case({path: _value(rows, path, row) for path in family.space.sets})


def _value(rows: Columns, path: str, row: int) -> Array:
    """Return the value of a path in a row: a single number, or the array of the columns `path[0]`, `path[1]`, ..."""
    if path in rows:
        return np.asarray(rows[path][row])
    texts = {name: name[len(path) + 1 : -1] for name in rows if name.startswith(f"{path}[")}
    indices = {name: tuple(int(k) for k in text.split(",")) for name, text in texts.items()}
    array = np.zeros(np.max(list(indices.values()), axis=0) + 1)
    for name, index in indices.items():
        array[index] = rows[name][row]
    return array


def frame(rows: str | Path | Columns, kind: Kind = "pandas") -> Any:
    """Return a data frame with a row per case: its uncertain values, outcome and metrics. In pandas, `attrs` has units.

    - `rows`: folder of a study, its `rows.parquet`, or its columns by name, such as `result.table`.
    - `kind`: "pandas" or "polars".

    Raises DefinitionError if there is no such file, or the library is unknown or not installed.
    """
    columns = rows if isinstance(rows, dict) else read_rows(rows)
    return data_frame(columns, kind, {name: _unit(COLUMNS.get(name, "")) for name in columns})


def _unit(meaning: str) -> str:
    """Return the unit in brackets at the end of a column's meaning; empty without one."""
    result = re.search(r"\[([^\]]*)\]$", meaning)
    return result[1] if result else ""
