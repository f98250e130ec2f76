"""Files of a study's folder as they are read back: whole and of this study, or named as damaged."""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, plain
from slidax.simulation import parquet

from .table import Columns

IDENTITY = "study.json"

STUDY, CONTENT = b"study", b"content"
"""Keys of a part's metadata: which study its rows belong to, and a checksum of their values."""

LARGEST_IDENTITY, LARGEST_PART, LARGEST_ROWS = 64_000_000, 1_000_000_000, 8_000_000_000
"""Sizes up to which files of a store are read [bytes]."""

MOST_NUMBERS = 10**9
"""Numbers in a table that is read; a small file may stand for more."""


class DamagedError(Exception):
    """A file of a store is not whole, or belongs to another study; the text says which of these."""


def read_identity(folder: Path) -> dict[str, Any]:
    """The contents of `study.json`.

    - `folder`: of the study.

    Raises DefinitionError if there is none, or it is damaged.
    """
    path = folder / IDENTITY
    try:
        return identity_in(path)
    except DamagedError as error:
        raise DefinitionError(
            f"`{path}` {error}: `slidax study FILE --out {folder} --resume` writes it again"
        ) from None


def study_of_rows(path: Path) -> str | None:
    """The digest of the study that a file's rows belong to; None if it does not say so, or cannot be read.

    - `path`: of a part or of `rows.parquet`.
    """
    import pyarrow.parquet as pq

    try:
        _require_regular(path, None)
        mark = (pq.read_schema(path).metadata or {}).get(STUDY)
    except Exception:
        return None
    return None if mark is None else str(mark.decode("ascii", "replace"))


def read_table(path: Path, rows: int | None = None, *, largest: int = LARGEST_PART) -> Any:
    """A Parquet file as a table.

    - `path`: the file.
    - `rows`: how many there must be; None for any number.
    - `largest`: size up to which it is read [bytes].

    Raises FileNotFoundError if there is none, and DamagedError if it is something else or not whole.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        _require_regular(path, largest)
        with pq.ParquetFile(pa.BufferReader(path.read_bytes())) as file:
            if rows is not None and file.metadata.num_rows != rows:
                raise DamagedError("has other rows than its name says")
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
        # Also a lack of memory: a damaged file may name any size.
        raise DamagedError(_unreadable(error)) from None


def _unreadable(error: Exception) -> str:
    reason = str(error).partition("\n")[0].rstrip(".")
    return f"is damaged or no Parquet file ({plain(reason) or type(error).__name__})"


def _require_regular(path: Path, largest: int | None) -> None:
    about = path.stat()
    if not stat.S_ISREG(about.st_mode):
        raise DamagedError("is no regular file")
    if largest is not None and about.st_size > largest:
        raise DamagedError(f"has {about.st_size} bytes, and at most {largest} are read")


def columns_in(table: Any) -> Columns:
    """The columns of a table as arrays.

    - `table`: of pyarrow.
    """
    columns: Columns = {}
    for name in table.column_names:
        column = table.column(name)
        values = column.to_numpy()
        # A missing number is null in the file, and NaN here.
        columns[name] = values.astype(float) if column.null_count else values
    return columns


def as_table(columns: Columns, notes: Mapping[str, str]) -> Any:
    """Columns as a table of pyarrow.

    - `columns`: by name.
    - `notes`: what the table says of its columns, by name.
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
    """A checksum of names, types and values.

    - `columns`: by name.
    """
    total = hashlib.sha256()
    for name, values in columns.items():
        kind = values.dtype.kind
        total.update(f"{name}\0{kind}\0{len(values)}\0".encode("utf-8", "surrogatepass"))
        if kind == "f":
            # Every NaN is the same null in a file.
            total.update(np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes())
        else:
            total.update(str(values.tolist()).encode("utf-8", "surrogatepass"))
    return total.hexdigest()


def digest_of(identity: Mapping[str, Any]) -> str:
    """A short name of a study, from all that its rows depend on.

    - `identity`: the contents of `study.json`; who made it is left out.
    """
    content = {key: value for key, value in identity.items() if key != "made_by"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


def identity_in(path: Path) -> dict[str, Any]:
    """The contents of a `study.json`.

    - `path`: the file.

    Raises DamagedError if it is missing or cannot be read.
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
