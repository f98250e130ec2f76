"""Columns of numbers in a Parquet file, by pyarrow."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError


def require_pyarrow(doing: str) -> None:
    """Raises a DefinitionError with the remedy if pyarrow, which reads and writes Parquet, is not installed.

    - `doing`: what it is needed for, as the message begins.
    """
    try:
        import pyarrow.parquet  # noqa: F401  (only whether it is there)
    except ImportError:
        raise DefinitionError(f"{doing} needs pyarrow, which is not installed: pip install 'slidax[parquet]'") from None


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """The columns of a Parquet file by name, in its order.

    - `path`: the file, such as the `log.parquet` of a saved run.

    Raises DefinitionError if it cannot be read, is no Parquet file, has two columns of one name, or pyarrow is
    missing.
    """
    require_pyarrow("reading the log")
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0]
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None
    return {name: np.asarray(table.column(name)) for name in table.column_names}
