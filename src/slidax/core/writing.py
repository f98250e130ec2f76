"""Replace files atomically: a reader sees the old content or the new content, never a part of it."""

from __future__ import annotations

import errno
import os
import platform
import re
import secrets
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

# On Windows nothing is locked, and no temporary file of another process is removed.
if sys.platform != "win32":
    import fcntl

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Error numbers of a full disk, a used-up quota and a limit on file sizes."""

ATTEMPTS = 5
"""Attempts to write a file whose temporary file disappears meanwhile."""

HOUR = 3600.0
"""Age from which a temporary file of another machine can be removed [s]. Its lock may be invisible: some network file
systems lock files for one machine only."""

_NAME = re.compile(r"\.slidax-(?P<host>.+)-\d+-[0-9a-f]{12}\.tmp")


def error_reason(error: OSError) -> str:
    """Text for a message: the reason why a file cannot be written, with a remedy if the disk is full."""
    text = error.strerror or str(error)
    if error.errno not in NO_ROOM:
        return text
    return f"{text}. Free some space or write elsewhere, and run the command again; files already written are complete"


def write_text(path: str | Path, text: str, *, follow: bool = True) -> None:
    """Replace a text file atomically, in UTF-8.

    - `path`: the file; its folder must exist.
    - `text`: its new content.
    - `follow`: as in `replace_file`.

    Raises OSError with the file's name if it cannot be written; the old file then stays.
    """
    write_bytes(path, text.encode("utf-8"), follow=follow)


def write_bytes(path: str | Path, content: bytes, *, follow: bool = True) -> None:
    """Replace a file atomically.

    - `path`: the file; its folder must exist.
    - `content`: its new content.
    - `follow`: as in `replace_file`.

    Raises OSError with the file's name if it cannot be written; the old file then stays.
    """
    for attempt in range(ATTEMPTS):
        try:
            with replace_file(path, follow=follow) as file:
                file.write(content)
            return
        except FileNotFoundError:
            # A machine that cannot see our lock may have removed the temporary file.
            if attempt == ATTEMPTS - 1 or not Path(path).parent.is_dir():
                raise


def create_text(path: str | Path, text: str) -> bool:
    """Write a text file unless it exists; return True if this call created it.

    - `path`: the file; its folder must exist.
    - `text`: its content.

    Raises OSError with the file's name if it cannot be written.
    """
    path = Path(path)
    with _named(path), _temporary(path.parent) as (file, name):
        file.write(text.encode("utf-8"))
        _flush(file)
        try:
            # Unlike a rename, a link never replaces a file.
            os.link(name, path)
        except FileExistsError:
            return False
        except OSError:
            # A file system without links.
            if path.exists():
                return False
            os.replace(name, path)
        _flush_folder(path.parent)
    return True


@contextmanager
def replace_file(path: str | Path, *, follow: bool = True) -> Iterator[IO[bytes]]:
    """Open a binary file that replaces `path` when the block ends without an error.

    - `path`: the file; its folder must exist.
    - `follow`: True writes the target of a link, and writes directly to a device or a pipe, such as `/dev/stdout`;
      False replaces the link, device or pipe itself.

    Raises OSError with the file's name if it cannot be written; the old file then stays.
    """
    path = Path(path)
    with _named(path):
        if follow and _is_special(path):
            with path.open("wb") as file:
                yield file
            return
        target = Path(os.path.realpath(path)) if follow else path
        if follow and target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        with _temporary(target.parent) as (file, name):
            yield file
            _flush(file)
            with suppress(OSError):
                about = target.lstat()
                if stat.S_ISREG(about.st_mode):
                    os.chmod(name, stat.S_IMODE(about.st_mode))
            os.replace(name, target)
            _flush_folder(target.parent)


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files from a folder if the processes that wrote them have ended.

    Without file locks, as on Windows, all temporary files stay.

    - `folder`: folder with files that this module wrote.
    """
    with suppress(OSError):
        for path in folder.iterdir():
            if is_temporary(path.name):
                with suppress(OSError):
                    _remove_if_abandoned(path)


def is_temporary(name: str) -> bool:
    """True if a file name, without its folder, is that of a temporary file of this module."""
    return _NAME.fullmatch(name) is not None


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9.]", "", platform.node())[:64] or "localhost"


@contextmanager
def _temporary(folder: Path) -> Iterator[tuple[IO[bytes], Path]]:
    """Open a new locked file in a folder; remove it at the end of the block unless it was renamed."""
    while True:
        name = folder / f".slidax-{_host()}-{os.getpid()}-{secrets.token_hex(6)}.tmp"
        handle = os.open(name, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o666)
        _lock(handle, wait=True)
        # Between these two calls another process may have removed the file as abandoned.
        if os.fstat(handle).st_nlink or os.name == "nt":
            break
        os.close(handle)
    try:
        with os.fdopen(handle, "wb", closefd=True) as file:
            yield file, name
    finally:
        with suppress(OSError):
            os.unlink(name)


def _remove_if_abandoned(path: Path) -> None:
    match = _NAME.fullmatch(path.name)
    foreign = match is None or match["host"] != _host()
    if foreign and time.time() - path.stat().st_mtime < HOUR:
        return
    handle = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    try:
        if _lock(handle, wait=False):
            os.unlink(path)
    finally:
        os.close(handle)


def _lock(handle: int, *, wait: bool) -> bool:
    """True if this process gets the lock; False if another process has it, or the file system has no locks."""
    if sys.platform == "win32":
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def _is_special(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _flush(file: IO[bytes]) -> None:
    file.flush()
    os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Make a rename survive a power failure, where folders can be flushed."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Make each OSError name the user's file instead of its temporary file."""
    try:
        yield
    except OSError as error:
        name = error.filename
        if error.errno is None or (name is not None and not is_temporary(Path(os.fsdecode(name)).name)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None
