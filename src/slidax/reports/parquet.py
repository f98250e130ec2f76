"""The log of a run as a Parquet file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from slidax._errors import DefinitionError
from slidax.simulation import Run


def require_pyarrow() -> None:
    """Raises a DefinitionError with the remedy if pyarrow, which writes Parquet, is not installed."""
    try:
        import pyarrow.parquet  # noqa: F401  (only whether it is there)
    except ImportError:
        raise DefinitionError(
            "writing the log needs pyarrow, which is not installed: pip install 'slidax[parquet]'"
        ) from None


def columns(run: Run) -> dict[str, np.ndarray]:
    """The log as flat columns: `t`, `q_1`, `dq_1`, `q_d_1`, ..., `tau_1`, the bounds, and the signals by name.

    - `run`: a finished run with a log.

    Raises DefinitionError if the run has no log.
    """
    log = run.log
    if log is None:
        raise DefinitionError("this run has no log: simulate with `log_every=1`")
    groups: dict[str, Any] = {
        "q": log.state.q,
        "dq": log.state.dq,
        "q_d": log.reference.q,
        "dq_d": log.reference.dq,
        "ddq_d": log.reference.ddq,
        "e": log.e,
        "tau": log.tau,
    }
    if log.envelope is not None:
        groups |= {"lower": log.envelope.lower, "upper": log.envelope.upper}
    groups |= log.signals
    table = {"k": np.asarray(log.k), "t": np.asarray(log.t)}
    for name, values in jax.tree.map(np.asarray, groups).items():
        if values.ndim == 1:
            table[name] = values
        else:
            flat = values.reshape(len(values), -1)
            table |= {f"{name}_{joint + 1}": flat[:, joint] for joint in range(flat.shape[1])}
    return table


def write_log(run: Run, path: Path) -> None:
    """Writes the log as a Parquet file, with the units of the joints in its metadata.

    - `run`: a finished run with a log.
    - `path`: where to; its folder is made if it is not there.

    Raises DefinitionError if the run has no log or pyarrow is not installed.
    """
    require_pyarrow()
    import pyarrow as pa
    import pyarrow.parquet as pq

    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table(columns(run))
    units = {"joint_units": ", ".join(run.joint_units), "period": f"{float(run.period)!r} s", "t": "s"}
    pq.write_table(table.replace_schema_metadata(units), path, compression="zstd")
