"""Cache of object code on disk, so that a machine compiles each program once.

Cached code is executed. The folder is therefore for its owner alone. Nothing is loaded through a symbolic link, or from
a folder or file that another user owns or may write.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

DIGEST = 32
"""Bytes of the checksum at the beginning of a file."""


def folder() -> Path:
    """Return the folder of the cache."""
    from platformdirs import user_cache_path

    return user_cache_path("slidax") / "native"


def path_of(key: str) -> Path:
    """Return the file for a key, which contains all that the object code depends on."""
    return folder() / f"{hashlib.sha256(key.encode()).hexdigest()}.o"


def load_code(key: str) -> bytes | None:
    """Return the object code for a key; None if there is none, or none that can be trusted."""
    path = path_of(key)
    try:
        if not path.parent.is_dir() or not _is_private(path.parent):
            return None
        handle = os.open(path, os.O_RDONLY | _BINARY | _NOT_THROUGH_LINKS)
        with os.fdopen(handle, "rb") as file:
            if _fault(os.fstat(file.fileno()), stat.S_ISREG):
                return None
            data = file.read()
    except OSError:
        return None
    body = data[DIGEST:]
    return body if _checksum(key, body) == data[:DIGEST] else None


def store_code(key: str, body: bytes) -> None:
    """Store object code for a key, if the disk can be written."""
    path = path_of(key)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(path.parent):
            return
        # Written under another name first, so that no process reads an incomplete file.
        handle, name = tempfile.mkstemp(dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_checksum(key, body) + body)
            os.replace(name, path)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        pass  # the next process compiles again


_NOT_THROUGH_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_BINARY = getattr(os, "O_BINARY", 0)


def _checksum(key: str, body: bytes) -> bytes:
    """Checksum of key and code, which also rejects a file under another key's name."""
    return hashlib.sha256(f"{key}\n".encode() + body).digest()


def _is_private(folder: Path) -> bool:
    """True if the folder can be used. Closes the user's own folder to others first."""
    status = os.lstat(folder)
    own = hasattr(os, "getuid") and stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    if own and stat.S_IMODE(status.st_mode) != 0o700:
        os.chmod(folder, 0o700)
        status = os.lstat(folder)
    fault = _fault(status, stat.S_ISDIR)
    if fault:
        warnings.warn(f"native code is not cached on disk, because `{folder}` {fault}", stacklevel=2)
    return not fault


def _fault(status: os.stat_result, is_kind: Callable[[int], bool]) -> str:
    """Reason not to use a folder or file; empty if there is none."""
    if stat.S_ISLNK(status.st_mode):
        return "is a symbolic link"
    if not is_kind(status.st_mode):
        return "is of another kind"
    if not hasattr(os, "getuid"):
        # Windows: the folder is in the user's profile, which is closed to others by default.
        return ""
    if status.st_uid != os.getuid():
        return "belongs to another user"
    return "may be written by other users" if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""
