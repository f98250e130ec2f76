"""The log of a run as a Parquet file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slidax._writing import replacing
from slidax.simulation import Run, columns_of, require_pyarrow


def columns(run: Run) -> dict[str, np.ndarray]:
    """The log of a `run` as flat columns: `t`, `q_1`, `dq_1`, `q_d_1`, ..., `tau_1`, the bounds, and the signals.

    Raises DefinitionError if the run has no log.
    """
    numbered = [f"_{joint + 1}" for joint in range(run.joints)]
    return {name: values for name, (values, _) in columns_of(run, numbered).items()}


def write_log(run: Run, path: Path) -> None:
    """Write the log of a `run` to `path` as Parquet, with the joints' units in its metadata.

    Raises DefinitionError if the run has no log or pyarrow is not installed.
    """
    require_pyarrow("writing the log")
    import pyarrow as pa
    import pyarrow.parquet as pq

    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table(columns(run))
    units = {"joint_units": ", ".join(run.joint_units), "period": f"{float(run.period)!r} s", "t": "s"}
    with replacing(path) as file:
        pq.write_table(table.replace_schema_metadata(units), file, compression="zstd")
