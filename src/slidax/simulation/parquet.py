"""Columns of numbers in a Parquet file, with pyarrow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, plain_name
from slidax.core.files import MEGABYTE, require_file

MOST_BYTES = 4000 * MEGABYTE
"""Largest file that is read."""

MOST_NUMBERS = 10**8
"""Limit of the columns that are read; a small file may declare billions."""


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

    Raises DefinitionError if it cannot be read, is no Parquet file, has two columns of one name or a column without
    numbers, or pyarrow is missing.
    """
    table = read_table(path)
    return {name: np.asarray(table.column(name)) for name in table.column_names}


def read_table(path: Path, choose: Callable[[Any, dict[str, int]], list[str]] | None = None) -> Any:
    """Return a table of pyarrow with some columns of a Parquet file.

    - `path`: of the file.
    - `choose`: names the columns, of the file's schema, and of the columns with lists, each with how many entries the
      list of the first row has; all columns if not given.

    Raises DefinitionError if it cannot be read, is no Parquet file, has two columns of one name, a column without
    numbers or more numbers than are read, or pyarrow is missing; and whatever `choose` raises.
    """
    require_pyarrow("reading the log")
    import pyarrow.parquet as pq

    require_file(path, most=MOST_BYTES)
    try:
        with pq.ParquetFile(path) as file:
            require_names(file, f"`{path}`:")
            sizes = {} if choose is None else _list_sizes(file)
            names = file.schema_arrow.names if choose is None else choose(file.schema_arrow, sizes)
            require_numbers(file, f"`{path}`:", names, sizes)
            return file.read(columns=names)
    except DefinitionError:
        raise
    # pyarrow raises whatever a damaged byte leads it to.
    except Exception as error:
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0] or type(error).__name__
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None


def read_text_lists(path: Path, titles: Collection[str]) -> tuple[str, set[tuple[str, ...]]]:
    """Return the first column with lists of texts, and its different lists.

    The texts stay in their dictionary until the different lists are known, since a few bytes can stand for many texts.

    - `path`: of the file.
    - `titles`: that the column may have, in small letters.

    Raises DefinitionError if the file cannot be read, or has more texts than numbers are read. The name is empty and
    there is no list if there is no such column.
    """
    require_pyarrow("reading the log")
    import pyarrow.parquet as pq
    from pyarrow import types

    require_file(path, most=MOST_BYTES)
    try:
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
                places = np.asarray(texts.indices.fill_null(-1))
                ends = np.cumsum(np.asarray(column.value_lengths().fill_null(0)))
                for row in {tuple(part) for part in np.split(places, ends[:-1])}:
                    lists.add(tuple("" if place < 0 else texts.dictionary[int(place)].as_py() for place in row))
        return field.name, lists
    except DefinitionError:
        raise
    # pyarrow raises whatever a damaged byte leads it to.
    except Exception as error:
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0] or type(error).__name__
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None


def require_names(file: Any, name: str) -> None:
    """Check that each column of a Parquet file has a name of its own.

    - `file`: a `ParquetFile` of pyarrow.
    - `name`: the file's name, for messages.

    Raises DefinitionError if two columns have one name.
    """
    doubled = [title for title, count in Counter(file.schema_arrow.names).items() if count > 1]
    if doubled:
        raise DefinitionError(f"{name} it has two columns `{plain_name(doubled[0])}`: rename one of them")


def require_numbers(
    file: Any, name: str, columns: Sequence[str], sizes: Mapping[str, int], *, most: int | None = None
) -> None:
    """Check columns of a Parquet file before they are read: numbers alone, and not too many.

    A few bytes can stand for gigabytes of equal numbers or texts. The metadata of column chunks would say more, but
    pyarrow ends the process where they are damaged.

    - `file`: a `ParquetFile` of pyarrow.
    - `name`: the file's name, for messages.
    - `columns`: names of the columns that are needed.
    - `sizes`: how many numbers are in each row of those columns that may have lists.
    - `most`: how many numbers are read; `MOST_NUMBERS` if not given.

    Raises DefinitionError if a column has no numbers, or there are too many.
    """
    most = MOST_NUMBERS if most is None else most
    schema, rows = file.schema_arrow, file.metadata.num_rows
    for title in columns:
        kind = schema.field(title).type
        word = plain_name(str(kind))
        if not _has_numbers(kind.value_type if title in sizes else kind):
            raise DefinitionError(
                f"{name} column `{plain_name(title)}` has the type {word}, and is no numbers: write it as float64"
            )
    if rows * sum(max(sizes.get(title, 1), 1) for title in columns) > most:
        raise DefinitionError(
            f"{name} it has {rows} rows, and {len(columns)} columns of them are needed: at most {most:.0e} numbers are "
            "read; write a part of it, or each second row"
        )


def _has_numbers(kind: Any) -> bool:
    from pyarrow import types

    if types.is_dictionary(kind):
        kind = kind.value_type
    # Of no type at all is a column without a value.
    return bool(types.is_primitive(kind) or types.is_decimal(kind) or types.is_null(kind))


def _list_sizes(file: Any) -> dict[str, int]:
    """For each column with lists of numbers, how many entries the list of the first row has."""
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
