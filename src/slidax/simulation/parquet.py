"""Columns of numbers in a Parquet file, by pyarrow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax._files import MEGABYTE, require_file

MOST_BYTES = 4000 * MEGABYTE
"""Of a file."""

MOST_NUMBERS = 10**8
"""In the columns that are read; a small file may announce billions."""


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
    table = read_table(path)
    return {name: np.asarray(table.column(name)) for name in table.column_names}


def read_table(path: Path, choose: Callable[[Any, dict[str, int]], list[str]] | None = None) -> Any:
    """Return a table of pyarrow with some columns of a Parquet file.

    - `path`: of the file.
    - `choose`: names the columns, of the file's schema, and of the columns with lists, each with how many entries the
      list of the first row has; all columns if not given.

    Raises DefinitionError if it cannot be read, is no Parquet file, has two columns of one name or more numbers than
    are read, or pyarrow is missing; and whatever `choose` raises.
    """
    require_pyarrow("reading the log")
    import pyarrow.parquet as pq

    require_file(path, most=MOST_BYTES)
    try:
        with pq.ParquetFile(path) as file:
            schema, rows = file.schema_arrow, file.metadata.num_rows
            names = list(schema.names)
            doubled = [name for name, count in Counter(names).items() if count > 1]
            if doubled:
                raise DefinitionError(f"`{path}` has two columns `{doubled[0]}`: rename one of them")
            if choose is not None:
                names = choose(schema, _list_sizes(file, schema))
            if rows * max(len(names), 1) > MOST_NUMBERS:
                raise DefinitionError(
                    f"`{path}` has {rows} rows, and {len(names)} columns of them are needed: at most "
                    f"{MOST_NUMBERS:.0e} numbers are read; write a part of it, or each second row"
                )
            return file.read(columns=names)
    except DefinitionError:
        raise
    # pyarrow raises whatever a damaged byte leads it to.
    except Exception as error:
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0] or type(error).__name__
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None


def _list_sizes(file: Any, schema: Any) -> dict[str, int]:
    """For each column with lists, how many entries the list of the first row has."""
    import pyarrow as pa

    lists = [field.name for field in schema if pa.types.is_list(field.type) or pa.types.is_fixed_size_list(field.type)]
    if not lists or not file.metadata.num_rows:
        return {}
    first = next(file.iter_batches(batch_size=1, columns=lists))
    return {name: min(len(first.column(name)[0].as_py() or ()), 1000) for name in lists}


def element(column: Any, place: int) -> Any:
    """Return the entries at one place of the lists in a column.

    - `column`: of pyarrow, with lists.
    - `place`: counted from 0.

    Raises DefinitionError if a list is too short.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        return pc.list_element(column, place)
    except pa.ArrowInvalid:
        raise DefinitionError(
            f"the lists in a column are of different lengths: entry {place} is missing in one"
        ) from None
