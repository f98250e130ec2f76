"""A run that `slidax run --out` has written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError
from slidax.scenarios import Scenario, load
from slidax.simulation import read_columns

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
    columns = read_columns(folder / LOG)
    return load(folder / SCENARIO), columns
