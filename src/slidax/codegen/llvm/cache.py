"""Object code kept on disk, so that the same loop is compiled once on a machine."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

DIGEST = 32
"""Bytes of the sum that a file begins with."""


def folder() -> Path:
    """Where the files are."""
    from platformdirs import user_cache_path

    return user_cache_path("slidax") / "native"


def remembered(key: str, make: Callable[[], bytes]) -> bytes:
    """What `make()` gave for the same key, from the disk if it is there and whole.

    - `key`: all that it depends on.
    - `make`: gives the bytes; what it gives is kept if the disk lets it.
    """
    path = folder() / f"{hashlib.sha256(key.encode()).hexdigest()}.o"
    known = _read(path)
    if known is not None:
        return known
    made = make()
    _write(path, made)
    return made


def _read(path: Path) -> bytes | None:
    try:
        held = path.read_bytes()
    except OSError:
        return None
    body = held[DIGEST:]
    return body if hashlib.sha256(body).digest() == held[:DIGEST] else None


def _write(path: Path, body: bytes) -> None:
    # Under another name first: nobody is to see half of it.
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(body).digest() + body)
            os.replace(name, path)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        pass  # a full or locked disk costs the next process a compilation, no more
