"""The rows of a study as a data frame."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from slidax.simulation.frames import Kind, data_frame

from .store import read_rows
from .table import COLUMNS, Columns


def frame(rows: str | Path | Columns, kind: Kind = "pandas") -> Any:
    """A data frame with a row per case: its values by path, outcome and metrics; pandas has units in `attrs`.

    - `rows`: a folder or a file of a study, or its columns by name, such as `result.table`.
    - `kind`: "pandas" or "polars".

    Raises DefinitionError if there is no such file, or the library is another or is not installed.
    """
    columns = rows if isinstance(rows, dict) else read_rows(rows)
    return data_frame(columns, kind, {name: _unit(COLUMNS.get(name, "")) for name in columns})


def _unit(meaning: str) -> str:
    """The unit in brackets at the end of a meaning."""
    result = re.search(r"\[([^\]]*)\]$", meaning)
    return result[1] if result else ""
