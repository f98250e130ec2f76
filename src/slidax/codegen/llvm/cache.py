"""Object code kept on disk, so that the same loop is compiled once on a machine.

What is kept is run. So the folder is for its owner alone, and nothing is taken from a folder or a file that another
user owns or may write, nor through a symbolic link.
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
"""Bytes of the checksum that a file begins with."""


def folder() -> Path:
    """Where the files are."""
    from platformdirs import user_cache_path

    return user_cache_path("slidax") / "native"


def path_of(key: str) -> Path:
    """The file for a key.

    - `key`: all that the object code depends on.
    """
    return folder() / f"{hashlib.sha256(key.encode()).hexdigest()}.o"


def kept(key: str) -> bytes | None:
    """What was kept for a key; None if there is nothing, or nothing that may be trusted.

    - `key`: as in `path_of`.
    """
    path = path_of(key)
    try:
        if not path.parent.is_dir() or not _is_private(path.parent):
            return None
        handle = os.open(path, os.O_RDONLY | _BINARY | _NOT_THROUGH_LINKS)
        with os.fdopen(handle, "rb") as file:
            if _fault(os.fstat(file.fileno()), stat.S_ISREG):
                return None
            held = file.read()
    except OSError:
        return None
    body = held[DIGEST:]
    return body if _checksum(key, body) == held[:DIGEST] else None


def keep(key: str, body: bytes) -> None:
    """Keeps object code for a key, if the disk lets it.

    - `key`: as in `path_of`.
    - `body`: the object code.
    """
    path = path_of(key)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(path.parent):
            return
        # Under another name first, so that no reader finds a part of it.
        handle, name = tempfile.mkstemp(dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_checksum(key, body) + body)
            os.replace(name, path)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        pass  # a full or locked disk costs the next process a compilation, no more


_NOT_THROUGH_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_BINARY = getattr(os, "O_BINARY", 0)


def _checksum(key: str, body: bytes) -> bytes:
    """Of the key too: a file under another's name is not taken for it."""
    return hashlib.sha256(f"{key}\n".encode() + body).digest()


def _is_private(place: Path) -> bool:
    """Whether a folder may be used; one of the user's own that others may enter is closed to them."""
    found = os.lstat(place)
    own = hasattr(os, "getuid") and stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    if own and stat.S_IMODE(found.st_mode) != 0o700:
        os.chmod(place, 0o700)
        found = os.lstat(place)
    fault = _fault(found, stat.S_ISDIR)
    if fault:
        warnings.warn(f"native code is not kept on disk, as `{place}` {fault}", stacklevel=2)
    return not fault


def _fault(found: os.stat_result, is_kind: Callable[[int], bool]) -> str:
    """What speaks against using a folder or a file."""
    if stat.S_ISLNK(found.st_mode):
        return "is a symbolic link"
    if not is_kind(found.st_mode):
        return "is something else"
    if not hasattr(os, "getuid"):
        # Windows: the folder lies in the user's profile, which is closed to others by default.
        return ""
    if found.st_uid != os.getuid():
        return "belongs to another user"
    return "may be written by other users" if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""
