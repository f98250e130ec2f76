"""The one folder that the studio reads and writes, with links resolved and nothing followed out of it."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from slidax._errors import DefinitionError, plain

from .names import READ, WRITTEN, OutsideError, parts_of, require_ending

MOST_FILES = 2000
"""In a listing."""

DEEPEST = 6
"""Folders in each other in a listing."""

BY_DESCRIPTOR = os.open in os.supports_dir_fd
"""Whether the system opens a file in an open folder, so that no folder above it can be swapped meanwhile."""

_FOLDER = getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | os.O_RDONLY
_FILE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)


@dataclass(frozen=True)
class Entry:
    """A file in a listing.

    - `name`: from the folder, with `/`.
    - `size`: bytes.
    - `changed`: when, s since 1970.
    """

    name: str
    size: int
    changed: float


class Folder:
    """Files below one folder.

    - `root`: the folder, which must be there.

    Raises DefinitionError if it is no folder.
    """

    def __init__(self, root: Path) -> None:
        try:
            self.root = root.resolve(strict=True)
        except (OSError, RuntimeError):
            raise DefinitionError(f"there is no folder `{plain(str(root))}`") from None
        if not self.root.is_dir():
            raise DefinitionError(f"`{plain(str(root))}` is no folder")

    def place(self, name: str) -> Path:
        """Where a file is, or would be, with every link resolved.

        - `name`: as a browser sends it.

        Raises OutsideError if that is not below the folder.
        """
        return self.beneath(self.root.joinpath(*parts_of(name)), name)

    def beneath(self, path: Path, name: str) -> Path:
        """A path with every link resolved.

        - `path`: from wherever.
        - `name`: for the message.

        Raises OutsideError if it is not below the folder.
        """
        try:
            found = path.resolve()
        except (OSError, RuntimeError, ValueError):
            raise OutsideError(f"`{plain(name)}` has links that go round, or is no path") from None
        if found == self.root or not found.is_relative_to(self.root):
            raise OutsideError(f"`{plain(name)}` is outside of the studio's folder")
        return found

    def read(self, name: str, most: int) -> bytes:
        """What is in a file.

        - `name`: as a browser sends it.
        - `most`: bytes.

        Raises OutsideError if it is not below the folder, DefinitionError if it is no file, too large, or not there.
        """
        require_ending(name, READ)
        return self.content(self.place(name), name, most)

    def content(self, place: Path, name: str, most: int) -> bytes:
        """What is in a file that was found to be below the folder.

        - `place`: of `place` or `beneath`.
        - `name`: for messages.
        - `most`: bytes.

        Raises DefinitionError if it is no file, is too large, is not there, or has meanwhile become a link.
        """
        with _said(name), self._opened(place, os.O_RDONLY | _AT_ONCE) as handle:
            about = os.fstat(handle)
            if not stat.S_ISREG(about.st_mode):
                raise DefinitionError(f"`{plain(name)}` is no file")
            if about.st_size > most:
                raise DefinitionError(f"`{plain(name)}` has {about.st_size} bytes, at most {most} are read")
            with os.fdopen(os.dup(handle), "rb") as file:
                content = file.read(most + 1)
        if len(content) > most:
            raise DefinitionError(f"`{plain(name)}` grows: more than {most} bytes")
        return content

    def write(self, name: str, content: bytes, before: str | None = None) -> str:
        """Puts a file there, whole or not at all, and gives its mark.

        - `name`: as a browser sends it.
        - `content`: of the file.
        - `before`: the mark that the file has now; None for a file that is not there yet.

        Raises OutsideError if it is not below the folder, FileExistsError if the file is another one than `before`
        says, DefinitionError if it cannot be written.
        """
        require_ending(name, WRITTEN)
        place = self.place(name)
        with _said(name), self._parent(place, make=True) as parent:
            now = self._mark(place, name)
            if now != before:
                raise FileExistsError(errno.EEXIST, "it was changed meanwhile, or is there already", name)
            beside = f".{secrets.token_hex(8)}.part"
            handle = os.open(
                _at(place, beside, parent), os.O_WRONLY | os.O_CREAT | os.O_EXCL | _FILE, 0o644, **_in(parent)
            )
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(content)
                os.replace(
                    _at(place, beside, parent),
                    _at(place, place.name, parent),
                    **({} if parent is None else {"src_dir_fd": parent, "dst_dir_fd": parent}),
                )
            except BaseException:
                os.unlink(_at(place, beside, parent), **_in(parent))
                raise
        return mark_of(content)

    def is_free(self, name: str) -> bool:
        """Whether nothing is lost where a folder of results is written: it is not there, or empty.

        - `name`: as a browser sends it.

        Raises OutsideError if it is not below the folder, DefinitionError if it is something else.
        """
        place = self.place(name)
        with _said(name):
            return not place.exists() or (place.is_dir() and not any(place.iterdir()))

    def listing(self, folder: str = "") -> list[Entry]:
        """Files that can be shown, by name; hidden ones, links out of the folder and environments are left out.

        - `folder`: where; all if not given.
        """
        top = self.place(folder) if folder else self.root
        found: list[Entry] = []
        for place, folders, files in os.walk(top):
            depth = len(Path(place).relative_to(self.root).parts)
            folders[:] = sorted(one for one in folders if _shown(one) and depth < DEEPEST)
            if "pyvenv.cfg" in files or "node_modules" in Path(place).parts:
                folders.clear()
                continue
            for file in sorted(files):
                if not (_shown(file) and file.lower().endswith(READ)):
                    continue
                path = Path(place, file)
                with _ignored():
                    about = path.lstat()
                    if stat.S_ISREG(about.st_mode):
                        name = path.relative_to(self.root).as_posix()
                        parts_of(name)
                        found.append(Entry(name, about.st_size, about.st_mtime))
                if len(found) >= MOST_FILES:
                    return found
        return found

    def _mark(self, place: Path, name: str) -> str | None:
        try:
            with self._opened(place, os.O_RDONLY | _AT_ONCE) as handle:
                if not stat.S_ISREG(os.fstat(handle).st_mode):
                    raise DefinitionError(f"`{plain(name)}` is no file")
                with os.fdopen(os.dup(handle), "rb") as file:
                    return mark_of(file.read())
        except FileNotFoundError:
            return None

    @contextmanager
    def _opened(self, place: Path, flags: int) -> Iterator[int]:
        with self._parent(place) as parent:
            handle = os.open(_at(place, place.name, parent), flags | _FILE, **_in(parent))
            try:
                if parent is None and not os.path.samestat(os.fstat(handle), self.beneath(place, str(place)).stat()):
                    raise OutsideError("the file was replaced while it was opened")
                yield handle
            finally:
                os.close(handle)

    @contextmanager
    def _parent(self, place: Path, *, make: bool = False) -> Iterator[int | None]:
        """The open folder of a file, reached from the root without following a link; None where that cannot be."""
        if not BY_DESCRIPTOR:
            if make:
                place.parent.mkdir(parents=True, exist_ok=True)
            yield None
            return
        handle = os.open(self.root, _FOLDER)
        try:
            for part in place.relative_to(self.root).parts[:-1]:
                if make:
                    with _there():
                        os.mkdir(part, dir_fd=handle)
                inner = os.open(part, _FOLDER, dir_fd=handle)
                os.close(handle)
                handle = inner
            yield handle
        finally:
            os.close(handle)


def mark_of(content: bytes) -> str:
    """What says of a file whether it is the same as before.

    - `content`: of the file.
    """
    return hashlib.sha256(content).hexdigest()[:32]


def _shown(name: str) -> bool:
    return not name.startswith((".", "__", "~", "-"))


def _at(place: Path, name: str, parent: int | None) -> str:
    return name if parent is not None else str(place.parent / name)


def _in(parent: int | None) -> dict[str, int]:
    return {} if parent is None else {"dir_fd": parent}


@contextmanager
def _there() -> Iterator[None]:
    try:
        yield
    except FileExistsError:
        return


@contextmanager
def _ignored() -> Iterator[None]:
    try:
        yield
    except (OSError, OutsideError):
        return


@contextmanager
def _said(name: str) -> Iterator[None]:
    """What the system refuses, as a sentence; that a file is there already is for the caller."""
    try:
        yield
    except FileExistsError:
        raise
    except OSError as error:
        # A link that appeared after its name was resolved ends here: nothing is followed.
        if error.errno in (errno.ELOOP, errno.ENOTDIR, errno.EMLINK):
            raise OutsideError(f"`{plain(name)}` goes through a link or a file as if it were a folder") from None
        raise DefinitionError(f"cannot open `{plain(name)}`: {error.strerror}") from None
