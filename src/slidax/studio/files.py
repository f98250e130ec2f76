"""The folder that the studio reads and writes, and the file names that it accepts."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from slidax.core.errors import DefinitionError, plain_name

LONGEST, LONGEST_PART = 1024, 255
"""Largest number of characters in a name, and of bytes in one of its parts."""

DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
"""Device names on Windows, in any folder."""

WRITTEN = (".yaml", ".yml", ".json", ".jsonl", ".csv", ".parquet", ".mcap", ".urdf", ".xml", ".mjcf")
"""Endings of files that may be written; none is executable."""

READ = (*WRITTEN, ".html", ".svg", ".md", ".c", ".h", ".txt", ".png")
"""Endings of files that may be read."""


class OutsideError(DefinitionError):
    """A name that leads out of the studio's folder, or is invalid."""


def parts_of(name: str) -> tuple[str, ...]:
    """Return the parts of a file `name`, which has `/` between folders and file.

    Raises OutsideError if the name is absolute, leads upwards, is hidden, or is not portable between systems.
    """
    if not isinstance(name, str) or not name or len(name) > LONGEST:
        raise OutsideError(f"a file's name must have 1 to {LONGEST} characters")
    if any(not letter.isprintable() for letter in name) or any(letter in name for letter in '\\:*?"<>|'):
        raise OutsideError(f"`{plain_name(name)}` has a character that some systems do not allow in file names")
    parts = tuple(name.split("/"))
    for part in parts:
        if not part or part in (".", ".."):
            raise OutsideError(f"`{plain_name(name)}` must be below the folder: remove `..` and the leading `/`")
        if part.startswith((".", "~", "-")):
            raise OutsideError(f"`{plain_name(name)}` must not start with `.`, `~` or `-`: give it another name")
        if part.endswith((" ", ".")) or part.startswith(" ") or DEVICES.fullmatch(part):
            raise OutsideError(f"`{plain_name(name)}` is not a valid file name on every system: give it another name")
        if len(part.encode("utf-8", "surrogatepass")) > LONGEST_PART:
            raise OutsideError(f"a part of `{plain_name(name)}` is longer than {LONGEST_PART} bytes")
    return parts


def require_ending(name: str, endings: tuple[str, ...]) -> None:
    """Raise DefinitionError unless `name` has one of the `endings`, in lower case with their dots."""
    if not name.lower().endswith(endings):
        raise DefinitionError(f"`{plain_name(name)}` must end in one of {', '.join(endings)}")


MOST_FILES = 2000
"""Largest number of files in a listing."""

DEEPEST = 6
"""Largest nesting depth in a listing."""

BY_DESCRIPTOR = os.open in os.supports_dir_fd
"""True if the system can open files relative to an open folder, so that nobody can replace the folder in between."""

_FOLDER = getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | os.O_RDONLY
_FILE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)


@dataclass(frozen=True)
class FileEntry:
    """A file in a listing: `name` with `/`, `size` in bytes, time of its last change `changed` in s since 1970."""

    name: str
    size: int
    changed: float


class Folder:
    """Files below a folder `root`.

    Raises DefinitionError if `root` is not a folder.
    """

    def __init__(self, root: Path) -> None:
        try:
            self.root = root.resolve(strict=True)
        except (OSError, RuntimeError):
            raise DefinitionError(f"folder `{plain_name(str(root))}` does not exist") from None
        if not self.root.is_dir():
            raise DefinitionError(f"`{plain_name(str(root))}` is not a folder")

    def resolve(self, name: str) -> Path:
        """Return the path of a file by its `name` from a browser, with links resolved.

        Raises OutsideError if the file is not below the folder.
        """
        return self.beneath(self.root.joinpath(*parts_of(name)), name)

    def beneath(self, path: Path, name: str) -> Path:
        """Return a path with links resolved.

        - `path`: any path.
        - `name`: its name in messages.

        Raises OutsideError if the path is not below the folder.
        """
        try:
            real = path.resolve()
        except (OSError, RuntimeError, ValueError):
            raise OutsideError(f"`{plain_name(name)}` has circular links, or is not a path") from None
        if real == self.root or not real.is_relative_to(self.root):
            raise OutsideError(f"`{plain_name(name)}` is outside the studio's folder")
        return real

    def read(self, name: str, most: int) -> bytes:
        """Return the content of a file by its `name` from a browser, at most `most` bytes.

        Raises OutsideError if it is not below the folder, DefinitionError if it is not a file, or too large or missing.
        """
        require_ending(name, READ)
        return self.content(self.resolve(name), name, most)

    def content(self, path: Path, name: str, most: int) -> bytes:
        """Return the content of a file by its resolved `path`, at most `most` bytes; `name` is for messages.

        Raises DefinitionError if it is not a file, is too large or missing, or was replaced by a link.
        """
        with _refusals_as_sentences(name), self._opened(path, os.O_RDONLY | _AT_ONCE) as handle:
            about = os.fstat(handle)
            if not stat.S_ISREG(about.st_mode):
                raise DefinitionError(f"`{plain_name(name)}` is not a file")
            if about.st_size > most:
                raise DefinitionError(f"`{plain_name(name)}` has {about.st_size} bytes; at most {most} are allowed")
            with os.fdopen(os.dup(handle), "rb") as file:
                content = file.read(most + 1)
        if len(content) > most:
            raise DefinitionError(f"`{plain_name(name)}` grew to more than {most} bytes")
        return content

    def write(self, name: str, content: bytes, before: str | None = None) -> str:
        """Write a file atomically, and return its mark, a digest of its content.

        - `name`: name from a browser.
        - `before`: expected mark of the existing file; None for a new file.

        Raises OutsideError if it is not below the folder, FileExistsError if the mark differs, DefinitionError if it
        cannot be written.
        """
        require_ending(name, WRITTEN)
        path = self.resolve(name)
        with _refusals_as_sentences(name), self._parent(path, make=True) as parent:
            now = self._mark(path, name)
            if now != before:
                raise FileExistsError(errno.EEXIST, "the file was changed in the meantime, or exists already", name)
            temporary = f".{secrets.token_hex(8)}.part"
            handle = os.open(
                _sibling(path, temporary, parent), os.O_WRONLY | os.O_CREAT | os.O_EXCL | _FILE, 0o644, **_in(parent)
            )
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(content)
                os.replace(
                    _sibling(path, temporary, parent),
                    _sibling(path, path.name, parent),
                    **({} if parent is None else {"src_dir_fd": parent, "dst_dir_fd": parent}),
                )
            except BaseException:
                os.unlink(_sibling(path, temporary, parent), **_in(parent))
                raise
        return mark_of(content)

    def is_free(self, name: str) -> bool:
        """True if the results folder `name` does not exist or is empty.

        Raises OutsideError if it is not below the folder, DefinitionError if it cannot be read.
        """
        path = self.resolve(name)
        with _refusals_as_sentences(name):
            return not path.exists() or (path.is_dir() and not any(path.iterdir()))

    def listing(self, folder: str = "") -> list[FileEntry]:
        """Return the readable files below a `folder` (default: all), at most `MOST_FILES`.

        Hidden files, links, other endings than `READ`, Python and Node environments, and files more than `DEEPEST`
        folders deep are left out.
        """
        top = self.resolve(folder) if folder else self.root
        entries: list[FileEntry] = []
        for parent, folders, files in os.walk(top):
            depth = len(Path(parent).relative_to(self.root).parts)
            folders[:] = sorted(part for part in folders if _is_visible(part) and depth < DEEPEST)
            if "pyvenv.cfg" in files or "node_modules" in Path(parent).parts:
                folders.clear()
                continue
            for file in sorted(files):
                if not (_is_visible(file) and file.lower().endswith(READ)):
                    continue
                path = Path(parent, file)
                with suppress(OSError, OutsideError):
                    about = path.lstat()
                    if stat.S_ISREG(about.st_mode):
                        name = path.relative_to(self.root).as_posix()
                        parts_of(name)
                        entries.append(FileEntry(name, about.st_size, about.st_mtime))
                if len(entries) >= MOST_FILES:
                    return entries
        return entries

    def _mark(self, path: Path, name: str) -> str | None:
        try:
            with self._opened(path, os.O_RDONLY | _AT_ONCE) as handle:
                if not stat.S_ISREG(os.fstat(handle).st_mode):
                    raise DefinitionError(f"`{plain_name(name)}` is not a file")
                with os.fdopen(os.dup(handle), "rb") as file:
                    return mark_of(file.read())
        except FileNotFoundError:
            return None

    @contextmanager
    def _opened(self, path: Path, flags: int) -> Iterator[int]:
        with self._parent(path) as parent:
            handle = os.open(_sibling(path, path.name, parent), flags | _FILE, **_in(parent))
            try:
                if parent is None and not os.path.samestat(os.fstat(handle), self.beneath(path, str(path)).stat()):
                    raise OutsideError("the file was replaced while it was opened: try again")
                yield handle
            finally:
                os.close(handle)

    @contextmanager
    def _parent(self, path: Path, *, make: bool = False) -> Iterator[int | None]:
        """Open a file's folder, step by step from the root without following links; None if the system cannot."""
        if not BY_DESCRIPTOR:
            if make:
                path.parent.mkdir(parents=True, exist_ok=True)
            yield None
            return
        handle = os.open(self.root, _FOLDER)
        try:
            for part in path.relative_to(self.root).parts[:-1]:
                if make:
                    with suppress(FileExistsError):
                        os.mkdir(part, dir_fd=handle)
                inner = os.open(part, _FOLDER, dir_fd=handle)
                os.close(handle)
                handle = inner
            yield handle
        finally:
            os.close(handle)


def mark_of(content: bytes) -> str:
    """Return the mark of a file, a digest of its `content`."""
    return hashlib.sha256(content).hexdigest()[:32]


def _is_visible(name: str) -> bool:
    return not name.startswith((".", "__", "~", "-"))


def _sibling(path: Path, name: str, parent: int | None) -> str:
    """Return the path of a `name` next to `path`, relative to the open folder `parent` if there is one."""
    return name if parent is not None else str(path.parent / name)


def _in(parent: int | None) -> dict[str, int]:
    return {} if parent is None else {"dir_fd": parent}


@contextmanager
def _refusals_as_sentences(name: str) -> Iterator[None]:
    """Turn OSError into a DefinitionError; FileExistsError is left to the caller."""
    try:
        yield
    except FileExistsError:
        raise
    except OSError as error:
        # A link that appeared after the name was resolved is not followed.
        if error.errno in (errno.ELOOP, errno.ENOTDIR, errno.EMLINK):
            raise OutsideError(f"`{plain_name(name)}` has a link or a file where a folder must be") from None
        raise DefinitionError(f"cannot open `{plain_name(name)}`: {error.strerror}") from None
