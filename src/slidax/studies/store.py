"""The rows of a study on disk: a file with a checksum for each chunk of rows, and finally one table of all rows."""

from __future__ import annotations

import hashlib
import json
import re
import stat
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, DefinitionWarning, plain_name
from slidax.core.writing import create_text, is_temporary, remove_leftovers, replace_file, write_bytes, write_text
from slidax.simulation import parquet

from .cases import Columns

IDENTITY = "study.json"

STUDY, CONTENT = b"study", b"content"
"""Keys in the metadata of a part, the file of a chunk: the digest of its study, and a checksum of its values."""

LARGEST_IDENTITY, LARGEST_PART, LARGEST_ROWS = 64_000_000, 1_000_000_000, 8_000_000_000
"""Largest sizes of a store's files [bytes]."""

MOST_NUMBERS = 10**9
"""Largest number of values in a table that is read: a small compressed file can hold more than fits in memory."""


class DamagedError(Exception):
    """A file of a store is damaged, or belongs to another study; the message has the reason, but not the file."""


def read_identity(folder: Path) -> dict[str, Any]:
    """Return the contents of a folder's `study.json`.

    Raises DefinitionError if the file is missing or damaged.
    """
    path = folder / IDENTITY
    try:
        return identity_in(path)
    except DamagedError as error:
        raise DefinitionError(
            f"`{path}` {error}: `slidax study FILE --out {folder} --resume` writes it again"
        ) from None


def study_of_rows(path: Path) -> str | None:
    """Return the digest of the study to which a file belongs; None if it has none or cannot be read.

    - `path`: a part, which has the rows of one chunk, or `rows.parquet`.
    """
    import pyarrow.parquet as pq

    try:
        _require_regular(path, None)
        mark = (pq.read_schema(path).metadata or {}).get(STUDY)
    except Exception:
        return None
    return None if mark is None else str(mark.decode("ascii", "replace"))


def read_part(path: Path, rows: int | None = None, *, largest: int = LARGEST_PART) -> Any:
    """Return the contents of a Parquet file as a pyarrow table.

    - `path`: a part, or `rows.parquet`.
    - `rows`: required number of rows; None for any number.
    - `largest`: largest size of the file [bytes].

    Raises FileNotFoundError if the file is missing, and DamagedError if it is damaged or no Parquet file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        _require_regular(path, largest)
        with pq.ParquetFile(pa.BufferReader(path.read_bytes())) as file:
            if rows is not None and file.metadata.num_rows != rows:
                raise DamagedError("has other rows than those in its name")
            parquet.require_names(file, "is damaged:")
            parquet.require_numbers(file, "is damaged:", file.schema_arrow.names, {}, most=MOST_NUMBERS)
            return file.read()
    except FileNotFoundError:
        raise
    except DefinitionError as error:
        raise DamagedError(error.message) from None
    except OSError as error:
        if error.errno is not None:
            raise DamagedError(f"cannot be read ({error.strerror})") from None
        raise DamagedError(_unreadable(error)) from None
    except DamagedError:
        raise
    except Exception as error:
        # Includes MemoryError: a damaged file may claim any size.
        raise DamagedError(_unreadable(error)) from None


def _unreadable(error: Exception) -> str:
    reason = str(error).partition("\n")[0].rstrip(".")
    return f"is damaged or no Parquet file ({plain_name(reason) or type(error).__name__})"


def _require_regular(path: Path, largest: int | None) -> None:
    about = path.stat()
    if not stat.S_ISREG(about.st_mode):
        raise DamagedError("is not a regular file")
    if largest is not None and about.st_size > largest:
        raise DamagedError(f"has {about.st_size} bytes, and at most {largest} are read")


def columns_in(table: Any) -> Columns:
    """Return the columns of a pyarrow table as arrays."""
    columns: Columns = {}
    for name in table.column_names:
        column = table.column(name)
        values = column.to_numpy()
        # Missing values are null in the file, and NaN here.
        columns[name] = values.astype(float) if column.null_count else values
    return columns


def as_table(columns: Columns, notes: Mapping[str, str]) -> Any:
    """Return columns as a pyarrow table, with their meanings in its metadata, and null for NaN.

    - `columns`: columns by name.
    - `notes`: meanings of columns, by name.
    """
    import pyarrow as pa

    arrays, fields = [], []
    for name, values in columns.items():
        missing = np.isnan(values) if values.dtype.kind == "f" else None
        array = pa.array(values, mask=missing)
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata={"meaning": notes[name]} if name in notes else None))
    return pa.table(arrays, schema=pa.schema(fields))


def checksum(columns: Columns) -> str:
    """Return a checksum of the columns' names, types and values: SHA-256, in hexadecimal."""
    total = hashlib.sha256()
    for name, values in columns.items():
        kind = values.dtype.kind
        total.update(f"{name}\0{kind}\0{len(values)}\0".encode("utf-8", "surrogatepass"))
        if kind == "f":
            # Every NaN becomes the same null in a file.
            total.update(np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes())
        else:
            total.update(str(values.tolist()).encode("utf-8", "surrogatepass"))
    return total.hexdigest()


def digest_of(identity: Mapping[str, Any]) -> str:
    """Return the digest of a study, from everything that determines its rows.

    - `identity`: the contents of `study.json`; `made_by`, the software and machine, does not count.
    """
    content = {key: value for key, value in identity.items() if key != "made_by"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


def identity_in(path: Path) -> dict[str, Any]:
    """Return the contents of a `study.json`.

    - `path`: the file.

    Raises DamagedError if it is missing or damaged.
    """
    try:
        _require_regular(path, LARGEST_IDENTITY)
        identity = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DamagedError("is missing") from None
    except OSError as error:
        raise DamagedError(f"cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError):
        raise DamagedError("is damaged: it is no JSON text") from None
    if not isinstance(identity, dict) or not isinstance(identity.get("scenario"), dict):
        raise DamagedError("is damaged: it has no scenario")
    return identity


PARTS = "parts"
ROWS = "rows.parquet"

_PART = re.compile(r"(\d{12,18})-(\d{1,10})\.parquet")


class Store:
    """A folder with the rows of a study, which several processes may write at the same time.

    `study.json` identifies the study; `parts/` has a Parquet file for each completed chunk of rows; `rows.parquet`
    finally has all rows in order. Files are replaced atomically (`slidax.core.writing`): processes that compute the
    same rows write the same file, one after the other. Each part has a checksum and the digest of its study. A damaged
    part, or one of another study, is computed again.

    - `folder`: the folder; it is created if missing.
    - `identity`: contents of `study.json`: everything that determines the rows, such as scenario, sets and seed.
    - `resume`: True to keep the rows of this study that the folder has.
    - `notes`: meanings of the columns, by name.

    Raises DefinitionError if pyarrow is not installed, if the folder has other files or another study, or if it has
    this study and `resume` is False.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any], *, resume: bool, notes: Mapping[str, str]) -> None:
        parquet.require_pyarrow("keeping the rows of a study")
        self.folder = folder
        self.notes = dict(notes)
        self.digest = digest_of(identity)
        self._parts = folder / PARTS
        text = json.dumps(identity, indent=2, sort_keys=True, ensure_ascii=False)
        folder.mkdir(parents=True, exist_ok=True)
        if _is_free(folder) and create_text(folder / IDENTITY, text):
            self._parts.mkdir(exist_ok=True)
            return
        self._join(text, resume)
        self._parts.mkdir(exist_ok=True)
        for directory in (folder, self._parts):
            remove_leftovers(directory)

    def _join(self, text: str, resume: bool) -> None:
        """Check that a folder with files belongs to this study."""
        path = self.folder / IDENTITY
        if not path.exists() and not self._parts.is_dir():
            raise DefinitionError(f"the folder `{self.folder}` is not empty, and has no study: write to another folder")
        try:
            digest = digest_of(identity_in(path))
        except DamagedError as error:
            if not resume:
                raise DefinitionError(
                    f"`{path}` {error}: continue with --resume, which keeps the rows of this study, or write to "
                    "another folder"
                ) from None
            self._require_no_foreign_rows(path)
            _warn(f"`{path}` {error}: it is written again")
            write_text(path, text, follow=False)
            return
        if digest != self.digest:
            raise DefinitionError(f"the folder `{self.folder}` has rows of another study: write to another folder")
        if not resume:
            raise DefinitionError(
                f"the folder `{self.folder}` has rows of this study: continue with --resume, or write to another folder"
            )

    def _require_no_foreign_rows(self, path: Path) -> None:
        """Raise DefinitionError if a file of rows has another study's digest; used without a readable `study.json`."""
        for rows in (self.folder / ROWS, *(part for _, _, part in _parts_in(self._parts))):
            digest = study_of_rows(rows)
            if digest is not None and digest != self.digest:
                raise DefinitionError(
                    f"`{path}` is missing or damaged, and `{rows}` belongs to another study: write to another folder"
                )

    def read(self, first: int, rows: int) -> Columns | None:
        """Return the columns of a chunk's rows; None if they are not stored.

        A part that is damaged or belongs to another study counts as not stored, with a warning.

        - `first`: number of the first row.
        - `rows`: number of rows.
        """
        path = self._path(first, rows)
        if not path.exists():
            return None
        try:
            return columns_in(self._table(path, first, rows))
        except FileNotFoundError:
            return None
        except DamagedError as error:
            _warn(f"`{path}` {error}: its {rows} rows are computed again")
            return None

    def write(self, first: int, columns: Columns) -> None:
        """Write the rows of a chunk.

        - `first`: number of the first row.
        - `columns`: columns of the rows, by name.

        Raises OSError if the file cannot be written, such as on a full disk.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        path = self._path(first, len(next(iter(columns.values()))))
        marks = {STUDY: self.digest, CONTENT: checksum(columns)}
        # Encode in memory first: an error of the disk is then a plain OSError.
        buffer = pa.BufferOutputStream()
        pq.write_table(as_table(columns, self.notes).replace_schema_metadata(marks), buffer, compression="zstd")
        write_bytes(path, buffer.getvalue().to_pybytes(), follow=False)

    def finish(self, rows: int) -> Path:
        """Write the rows of all parts to `rows.parquet`, and return its path.

        - `rows`: required number of rows.

        Raises DefinitionError if rows are missing, and OSError if the table cannot be written.
        """
        import pyarrow.parquet as pq

        path = self.folder / ROWS
        with replace_file(path, follow=False) as file:
            expected, writer = 0, None
            try:
                for table in self._tables(rows):
                    writer = writer or pq.ParquetWriter(file, table.schema, compression="zstd")
                    writer.write_table(table, row_group_size=max(table.num_rows, 1))
                    expected += table.num_rows
            finally:
                if writer is not None:
                    writer.close()
            if expected != rows:
                raise DefinitionError(
                    f"the folder `{self.folder}` has {expected} of {rows} rows: continue with --resume"
                )
        return path

    def _tables(self, rows: int) -> Iterator[Any]:
        """Yield the tables of the parts in order, up to the first missing row."""
        # If a study was extended, its former last chunk exists in two lengths: use the longer one.
        parts = sorted(_parts_in(self._parts), key=lambda part: (part[0], -part[1]))
        expected = 0
        for first, number, path in parts:
            # There may be more rows than needed, from a longer study or an earlier stop.
            if first != expected or expected >= rows:
                continue
            try:
                table = self._table(path, first, number).slice(0, rows - expected)
            except DamagedError as error:
                _warn(f"`{path}` {error}: it is skipped")
                continue
            yield table.replace_schema_metadata({STUDY: self.digest})
            expected += table.num_rows

    def _table(self, path: Path, first: int, rows: int) -> Any:
        """Read a part; raise DamagedError unless it is intact and has these rows of this study."""
        table = read_part(path, rows)
        marks = table.schema.metadata or {}
        if marks.get(STUDY) != self.digest.encode():
            raise DamagedError("belongs to another study, or to an older version of slidax")
        try:
            columns = columns_in(table)
            intact = checksum(columns).encode() == marks.get(CONTENT)
        except Exception:
            intact = False
        if not intact:
            raise DamagedError("is damaged: its checksum is wrong")
        if not np.array_equal(columns.get("row", np.zeros(0)), np.arange(first, first + rows)):
            raise DamagedError("has other rows than those in its name")
        return table

    def _path(self, first: int, rows: int) -> Path:
        return self._parts / f"{first:012d}-{rows}.parquet"


def count_rows(folder: Path) -> int:
    """Return the number of rows that are stored in the parts of a study.

    - `folder`: folder of the study; it may be missing. Its subfolders, one for each scheme of a comparison, count too.
    """
    count = 0
    for parts in sorted({folder / PARTS, *folder.glob(f"*/{PARTS}")}):
        longest: dict[int, int] = {}
        for first, rows, _ in _parts_in(parts):
            longest[first] = max(longest.get(first, 0), rows)
        count += sum(longest.values())
    return count


def missing_rows(folder: Path, rows: int) -> list[range]:
    """Return the numbers of the rows that no part of a study has, as ranges in order.

    - `folder`: folder of the study, or of a scheme of a comparison; it may be missing.
    - `rows`: number of rows of the study.
    """
    gaps, end = [], 0
    for first, count, _ in sorted(_parts_in(folder / PARTS)):
        if first > end and end < rows:
            gaps.append(range(end, min(first, rows)))
        end = max(end, first + count)
    return [*gaps, range(end, rows)] if end < rows else gaps


def read_rows(path: str | Path) -> Columns:
    """Return the columns of a study's table `rows.parquet`, by name.

    - `path`: the file, or its folder.

    Raises DefinitionError if the file is missing or damaged.
    """
    parquet.require_pyarrow("reading the rows of a study")
    path = Path(path) if Path(path).suffix == ".parquet" and not Path(path).is_dir() else Path(path) / ROWS
    if not path.parent.is_dir():
        raise DefinitionError(f"cannot read the rows of a study: there is no folder `{path.parent}`")
    remedy = f"`slidax study FILE --out {path.parent} --resume` writes it again from the parts"
    try:
        return columns_in(read_part(path, largest=LARGEST_ROWS))
    except OSError as error:
        raise DefinitionError(f"cannot read the rows `{path}`: {error.strerror or error}; {remedy}") from None
    except DamagedError as error:
        raise DefinitionError(f"`{path}` {error}; {remedy}") from None


def _is_free(folder: Path) -> bool:
    """True if a folder is empty except for temporary files of other processes."""
    return all(is_temporary(entry.name) for entry in folder.iterdir())


def _parts_in(folder: Path) -> Iterator[tuple[int, int, Path]]:
    """Yield the first row, number of rows, and path of each part in a folder; other files are skipped."""
    for path in folder.glob("*.parquet"):
        match = _PART.fullmatch(path.name)
        if match is not None:
            yield int(match[1]), int(match[2]), path


def _warn(message: str) -> None:
    warnings.warn(message, DefinitionWarning, stacklevel=3)
