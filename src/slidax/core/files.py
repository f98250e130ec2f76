"""Read regular files up to a size limit."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

from .errors import DefinitionError, short_repr

MEGABYTE = 10**6

MOST_TEXT = 32 * MEGABYTE
"""Size limit for a file that is read into memory at once [bytes]."""

_BINARY = getattr(os, "O_BINARY", 0)
_NONBLOCK = getattr(os, "O_NONBLOCK", 0)


def open_file(path: Path, what: str = "the file", *, most: int = MOST_TEXT) -> BinaryIO:
    """Open a regular file for reading.

    A pipe or a device is refused before anything is read from it, since the data may never end, as in `/dev/zero`.

    - `what`: the file's role, for messages.
    - `most`: size limit [bytes].

    Raises DefinitionError if the file cannot be opened, is not a regular file, or exceeds the limit.
    """
    try:
        # Without O_NONBLOCK, opening a pipe would wait for its writer.
        handle = os.open(path, os.O_RDONLY | _BINARY | _NONBLOCK)
    except (OSError, ValueError) as error:
        raise _unreadable(path, what, getattr(error, "strerror", None) or str(error)) from None
    try:
        status = os.fstat(handle)
        if stat.S_ISDIR(status.st_mode):
            raise _unreadable(path, what, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(status.st_mode):
            raise _unreadable(path, what, "only regular files are read, and this is a pipe, a socket or a device")
        if status.st_size > most:
            raise _unreadable(path, what, _too_large(status.st_size, most))
        return os.fdopen(handle, "rb")
    except BaseException:
        with suppress(OSError):
            os.close(handle)
        raise


def require_file(path: Path, what: str = "the file", *, most: int = MOST_TEXT) -> int:
    """Check a file that another library will open, and return its size in bytes.

    - `path`, `what`, `most`: as in `open_file`.

    Raises DefinitionError as `open_file` does.
    """
    with open_file(path, what, most=most) as file:
        return os.fstat(file.fileno()).st_size


def read_bytes(path: Path, what: str = "the file", *, most: int = MOST_TEXT) -> bytes:
    """Return the content of a regular file.

    - `path`, `what`, `most`: as in `open_file`.

    Raises DefinitionError as `open_file` does.
    """
    with open_file(path, what, most=most) as file:
        try:
            # Some regular files, such as those in /proc, contain more than their size says.
            content = file.read(most + 1)
        except OSError as error:
            raise _unreadable(path, what, error.strerror or str(error)) from None
    if len(content) > most:
        raise _unreadable(path, what, _too_large(len(content), most))
    return content


def read_text(path: Path, what: str = "the file", *, most: int = MOST_TEXT) -> str:
    r"""Return the text of a regular file in UTF-8, without a byte order mark, with `\n` at the end of each line.

    - `path`, `what`, `most`: as in `open_file`.

    Raises DefinitionError as `open_file` does, or if the file is not UTF-8 text.
    """
    try:
        text = read_bytes(path, what, most=most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise _unreadable(path, what, "it is not UTF-8 text") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_json(text: str, name: str) -> Any:
    """Return the value of a JSON text.

    - `name`: file name, for messages.

    Raises DefinitionError if the text is not JSON, or nested too deeply.
    """
    try:
        return json.loads(text, parse_int=parse_integer)
    except json.JSONDecodeError as error:
        raise DefinitionError(f"{name} is not valid JSON: line {error.lineno}: {error.msg}") from None
    except RecursionError:
        raise DefinitionError(f"{name} is not valid JSON: its lists are nested too deeply") from None


def parse_integer(digits: str) -> int | float:
    """Convert an integer literal of JSON to an int, or to a float from 31 characters on; the float may be infinite."""
    return int(digits) if len(digits) <= 30 else float(digits)


def json_value(value: Any) -> Any:
    """Convert dataclasses, mappings, sequences, arrays and numbers to JSON values; non-finite numbers become None."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {str(key): json_value(entry) for key, entry in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [json_value(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _too_large(size: int, most: int) -> str:
    return f"it has {size / MEGABYTE:.3g} MB, and at most {most / MEGABYTE:.3g} MB are read"


def _unreadable(path: Path, what: str, why: str) -> DefinitionError:
    name = str(path) if len(str(path)) <= 1000 else short_repr(str(path))
    return DefinitionError(f"cannot read {what} `{name}`: {why}")
