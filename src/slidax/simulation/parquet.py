"""Read columns of numbers from Parquet files, with pyarrow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, plain_name
from slidax.core.files import MEGABYTE, require_file

MOST_BYTES = 4000 * MEGABYTE
"""Size limit of a file [bytes]."""

MOST_NUMBERS = 10**8
"""Largest number of numbers or strings to read; a small file may declare billions."""


def require_pyarrow(doing: str) -> None:
    """Raise a DefinitionError with the remedy if pyarrow, which reads and writes Parquet, is not installed.

    - `doing`: the operation that needs pyarrow, for the message: "reading the log".
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise DefinitionError(f"{doing} needs pyarrow, which is not installed: pip install 'slidax[parquet]'") from None


def read_columns(path: str | Path) -> dict[str, np.ndarray]:
    """Read all columns of a Parquet file, by name and in the file's order.

    - `path`: the file, such as the `log.parquet` of a saved run.

    Raises DefinitionError if the file cannot be read, is not Parquet, has two columns with the same name, a column
    without numbers or too many numbers, or pyarrow is missing.
    """
    table = read_table(Path(path))
    return {name: np.asarray(table.column(name)) for name in table.column_names}


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Check the file's size, and turn the errors of pyarrow into a DefinitionError."""
    require_file(path, most=MOST_BYTES)
    try:
        yield
    except DefinitionError:
        raise
    # A damaged file can make pyarrow raise any exception.
    except Exception as error:
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0] or type(error).__name__
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None


def read_table(path: Path, choose: Callable[[Any, dict[str, int]], list[str]] | None = None) -> Any:
    """Read some columns of a Parquet file as a pyarrow table.

    - `choose`: function that returns the names of the columns to read; by default all are read. Its arguments are the
      file's pyarrow schema, and the list lengths by column, for columns with lists of numbers.

    Raises DefinitionError if the file cannot be read, is not Parquet, has two columns with the same name, a column
    without numbers or too many numbers, or pyarrow is missing; passes on the errors of `choose`.
    """
    require_pyarrow("reading the log")
    import pyarrow.parquet as pq

    with _readable(path), pq.ParquetFile(path) as file:
        require_names(file, f"`{path}`:")
        sizes = {} if choose is None else _list_sizes(file)
        names = file.schema_arrow.names if choose is None else choose(file.schema_arrow, sizes)
        require_numbers(file, f"`{path}`:", names, sizes)
        return file.read(columns=names)


def read_text_lists(path: Path, titles: Collection[str]) -> tuple[str, set[tuple[str, ...]]]:
    """Return the name of the first column with lists of strings, such as joint names, and its distinct lists.

    Both are empty if there is no such column. The strings stay dictionary-encoded until the distinct lists are known,
    since a small file can contain very many strings.

    - `titles`: allowed names of the column, in lower case.

    Raises DefinitionError if the file cannot be read, or the column has too many strings.
    """
    require_pyarrow("reading the log")
    import pyarrow.parquet as pq
    from pyarrow import types

    with _readable(path):
        with pq.ParquetFile(path) as file:
            for field in file.schema_arrow:
                if (
                    field.name.lower() in titles
                    and (types.is_list(field.type) or types.is_fixed_size_list(field.type))
                    and not _has_numbers(getattr(field.type.value_type, "value_type", field.type.value_type))
                ):
                    break
            else:
                return "", set()
        leaf = next(
            column.path
            for column in map(file.schema.column, range(len(file.schema)))
            if column.path.startswith(f"{field.name}.")
        )
        lists: set[tuple[str, ...]] = set()
        total = 0
        with pq.ParquetFile(path, read_dictionary=[leaf]) as file:
            for batch in file.iter_batches(batch_size=10_000, columns=[field.name]):
                column = batch.column(0)
                texts = column.flatten()
                total += len(texts)
                if total > MOST_NUMBERS:
                    raise DefinitionError(
                        f"`{path}`: column `{plain_name(field.name)}` has more than {MOST_NUMBERS:.0e} texts: write a "
                        "column for each joint"
                    )
                if not types.is_dictionary(texts.type):
                    texts = texts.dictionary_encode()
                indices = np.asarray(texts.indices.fill_null(-1))
                ends = np.cumsum(np.asarray(column.value_lengths().fill_null(0)))
                for row in {tuple(part) for part in np.split(indices, ends[:-1])}:
                    lists.add(tuple("" if index < 0 else texts.dictionary[int(index)].as_py() for index in row))
        return field.name, lists


def require_names(file: Any, name: str) -> None:
    """Raise a DefinitionError if two columns of a Parquet file have the same name.

    - `file`: a `ParquetFile` of pyarrow.
    - `name`: beginning of the messages, such as "`log.parquet`:".
    """
    doubled = [title for title, count in Counter(file.schema_arrow.names).items() if count > 1]
    if doubled:
        raise DefinitionError(f"{name} it has two columns `{plain_name(doubled[0])}`: rename one of them")


def require_numbers(
    file: Any, name: str, columns: Sequence[str], sizes: Mapping[str, int], *, most: int | None = None
) -> None:
    """Raise a DefinitionError, before reading, if columns of a Parquet file are not numeric or too large.

    A small compressed file can expand to gigabytes. The metadata of column chunks would give exact sizes, but pyarrow
    crashes if they are damaged.

    - `file`: a `ParquetFile` of pyarrow.
    - `name`: beginning of the messages, as in `require_names`.
    - `columns`: names of the needed columns.
    - `sizes`: list length by column, for columns with lists of numbers.
    - `most`: largest number of values to read; `MOST_NUMBERS` by default.
    """
    most = MOST_NUMBERS if most is None else most
    schema, rows = file.schema_arrow, file.metadata.num_rows
    for title in columns:
        kind = schema.field(title).type
        word = plain_name(str(kind))
        if not _has_numbers(kind.value_type if title in sizes else kind):
            raise DefinitionError(
                f"{name} column `{plain_name(title)}` has the type {word}, which is not numeric: write it as float64"
            )
    if rows * sum(max(sizes.get(title, 1), 1) for title in columns) > most:
        raise DefinitionError(
            f"{name} it has {rows} rows in {len(columns)} needed columns, but at most {most:.0e} numbers are read: "
            "write a part of it, or every second row"
        )


def _has_numbers(kind: Any) -> bool:
    from pyarrow import types

    if types.is_dictionary(kind):
        kind = kind.value_type
    # A column without values has the null type.
    return bool(types.is_primitive(kind) or types.is_decimal(kind) or types.is_null(kind))


def _list_sizes(file: Any) -> dict[str, int]:
    """Return the length of the first list in each column with lists of numbers."""
    from pyarrow import types

    lists = [
        field.name
        for field in file.schema_arrow
        if (types.is_list(field.type) or types.is_fixed_size_list(field.type)) and _has_numbers(field.type.value_type)
    ]
    if not lists or not file.metadata.num_rows:
        return {}
    first = next(file.iter_batches(batch_size=1, columns=lists))
    return {name: min(len(first.column(name)[0].values or ()), 1000) for name in lists}


def element(column: Any, index: int) -> Any:
    """Return the entry at `index`, counted from 0, of each list in a pyarrow column.

    Raises DefinitionError if a list is too short.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        return pc.list_element(column, index)
    except pa.ArrowInvalid:
        raise DefinitionError(
            f"the lists in a column have different lengths: one has no entry {index}, counted from 0; write lists of "
            "equal length"
        ) from None
