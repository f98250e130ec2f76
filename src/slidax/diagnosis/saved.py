"""A run that `slidax run --out` has written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError
from slidax.scenarios import Scenario, load

SCENARIO, LOG = "scenario.yaml", "log.parquet"
"""The files of a saved run."""


def read_saved(folder: Path) -> tuple[Scenario, dict[str, np.ndarray]]:
    """The scenario of a saved run, and its log as flat columns.

    - `folder`: what `slidax run --out` has written.

    Raises DefinitionError if a file is missing or is none of ours, or pyarrow is not installed.
    """
    for name in (SCENARIO, LOG):
        if not (folder / name).is_file():
            raise DefinitionError(
                f"`{folder}` has no `{name}`: give the folder of a run that `slidax run SCENARIO --out "
                "FOLDER` has written"
            )
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise DefinitionError(
            "reading the log needs pyarrow, which is not installed: pip install 'slidax[parquet]'"
        ) from None
    try:
        table = pq.read_table(folder / LOG)
    except (OSError, pa.ArrowInvalid) as error:
        raise DefinitionError(f"cannot read the log `{folder / LOG}`: {str(error).partition(chr(10))[0]}") from None
    columns = {name: np.asarray(table.column(name)) for name in table.column_names}
    return load(folder / SCENARIO), columns
