"""The rows of a study on disk: parts that are written whole or not at all, and at the end one table."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax.simulation import parquet

from .table import Columns

IDENTITY = "study.json"
PARTS = "parts"
ROWS = "rows.parquet"


class Store:
    """A folder with the rows of one study.

    `study.json` says which study it is; `parts/` has the rows that are done, a Parquet file for each chunk of them,
    written under another name and then renamed, so that a part that is there is whole; `rows.parquet` has all of them
    in order, once they are.

    - `folder`: made if missing.
    - `identity`: what the rows depend on, such as scenario, sets and seed.
    - `resume`: whether rows that are there already are kept.
    - `notes`: what the table says of its columns, by name.

    Raises DefinitionError if the folder holds another study, or this one while it is not to be resumed.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any], *, resume: bool, notes: Mapping[str, str]) -> None:
        parquet.require_pyarrow("keeping the rows of a study")
        self.folder = folder
        self.notes = dict(notes)
        self._parts = folder / PARTS
        path = folder / IDENTITY
        text = json.dumps(identity, indent=2, sort_keys=True, ensure_ascii=False)
        if path.exists():
            if _without(path.read_text(encoding="utf-8")) != _without(text):
                raise DefinitionError(f"the folder `{folder}` holds rows of another study: write to another folder")
            if not resume:
                raise DefinitionError(
                    f"the folder `{folder}` has rows of this study: go on with --resume, or write to another folder"
                )
        elif folder.is_dir() and any(folder.iterdir()):
            raise DefinitionError(f"the folder `{folder}` is not empty, and holds no study: write to another folder")
        self._parts.mkdir(parents=True, exist_ok=True)
        for unfinished in self._parts.glob("*.tmp*"):
            unfinished.unlink()
        if not path.exists():
            _written(path, text)

    def read(self, first: int, rows: int) -> Columns | None:
        """The rows of one chunk, if they are done.

        - `first`: number of the first one.
        - `rows`: how many.
        """
        path = self._path(first, rows)
        return _columns(path) if path.exists() else None

    def write(self, first: int, columns: Columns) -> None:
        """Keeps the rows of one chunk.

        - `first`: number of the first one.
        - `columns`: of them.
        """
        import pyarrow.parquet as pq

        path = self._path(first, len(next(iter(columns.values()))))
        # A name of its own for each process, so that two that compute the same rows do no harm.
        unfinished = path.with_suffix(f".tmp{os.getpid()}")
        pq.write_table(_table(columns, self.notes), unfinished, compression="zstd")
        with unfinished.open("rb") as file:
            os.fsync(file.fileno())
        unfinished.replace(path)

    def parts(self) -> Iterator[tuple[int, Path]]:
        """The number of the first row, and the file, of each chunk that is done, in order.

        The last chunk of a study that was given more runs later is there twice: the longer one counts.
        """
        longest: dict[int, tuple[int, Path]] = {}
        for path in self._parts.glob("*.parquet"):
            first, rows = map(int, path.stem.split("-"))
            longest[first] = max(longest.get(first, (0, path)), (rows, path))
        for first in sorted(longest):
            yield first, longest[first][1]

    def finish(self, rows: int) -> Path:
        """Writes all rows as one table, part by part, and returns its path.

        - `rows`: how many there must be.

        Raises DefinitionError if some are missing.
        """
        import pyarrow.parquet as pq

        path = self.folder / ROWS
        unfinished = path.with_suffix(".tmp")
        expected, writer = 0, None
        try:
            for first, part in self.parts():
                # More may be there than is asked for, of a study that had more runs before, or that stopped since.
                if first != expected or expected >= rows:
                    break
                table = pq.read_table(part).slice(0, rows - expected)
                writer = writer or pq.ParquetWriter(unfinished, table.schema, compression="zstd")
                writer.write_table(table, row_group_size=max(table.num_rows, 1))
                expected += table.num_rows
        finally:
            if writer is not None:
                writer.close()
        if expected != rows:
            raise DefinitionError(f"the folder `{self.folder}` has {expected} of {rows} rows: go on with --resume")
        unfinished.replace(path)
        return path

    def _path(self, first: int, rows: int) -> Path:
        return self._parts / f"{first:012d}-{rows}.parquet"


def read_rows(path: str | Path) -> Columns:
    """The columns of a table of rows.

    - `path`: of `rows.parquet`, or of the folder that it is in.

    Raises DefinitionError if there is none.
    """
    parquet.require_pyarrow("keeping the rows of a study")
    path = Path(path) / ROWS if Path(path).is_dir() else Path(path)
    try:
        return _columns(path)
    except OSError as error:
        raise DefinitionError(f"cannot read the rows `{path}`: {error.strerror or error}") from None


def _columns(path: Path) -> Columns:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    found: Columns = {}
    for name in table.column_names:
        column = table.column(name)
        values = column.to_numpy()
        # A missing number is null in the file, and NaN here.
        found[name] = values.astype(float) if column.null_count else values
    return found


def _table(columns: Columns, notes: Mapping[str, str]) -> Any:
    import pyarrow as pa

    arrays, fields = [], []
    for name, values in columns.items():
        missing = np.isnan(values) if values.dtype.kind == "f" else None
        array = pa.array(values, mask=missing)
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata={"meaning": notes[name]} if name in notes else None))
    return pa.table(arrays, schema=pa.schema(fields))


def _without(text: str) -> Any:
    """The identity but for what rows do not depend on."""
    said = json.loads(text)
    return {key: value for key, value in said.items() if key != "made_by"}


def _written(path: Path, text: str) -> None:
    unfinished = path.with_suffix(".tmp")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(path)
