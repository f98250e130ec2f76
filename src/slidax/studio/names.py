"""File names from a browser that are valid on every system."""

from __future__ import annotations

import re

from slidax._errors import DefinitionError, plain

LONGEST, LONGEST_PART = 1024, 255
"""Characters of a name, and bytes of one of its parts."""

DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
"""Device names on Windows, in any folder."""

WRITTEN = (".yaml", ".yml", ".json", ".jsonl", ".csv", ".parquet", ".mcap", ".urdf", ".xml", ".mjcf")
"""Endings of files that may be written; none is executable."""

READ = (*WRITTEN, ".html", ".svg", ".md", ".c", ".h", ".txt", ".png")
"""Endings of files that may be read."""


class OutsideError(DefinitionError):
    """A name that leads out of the studio's folder, or is invalid."""


def parts_of(name: str) -> tuple[str, ...]:
    """The parts of a `name` with `/` between folders and file.

    Raises OutsideError if it is absolute, goes up, is hidden, or has another meaning on another system.
    """
    if not isinstance(name, str) or not name or len(name) > LONGEST:
        raise OutsideError(f"a file's name must have 1 to {LONGEST} characters")
    if any(not letter.isprintable() for letter in name) or any(letter in name for letter in '\\:*?"<>|'):
        raise OutsideError(f"`{plain(name)}` has a character that some systems do not allow in file names")
    parts = tuple(name.split("/"))
    for part in parts:
        if not part or part in (".", ".."):
            raise OutsideError(f"`{plain(name)}` must be below the folder: remove `..` and the leading `/`")
        if part.startswith((".", "~", "-")):
            raise OutsideError(f"`{plain(name)}` must not start with `.`, `~` or `-`: give it another name")
        if part.endswith((" ", ".")) or part.startswith(" ") or DEVICES.fullmatch(part):
            raise OutsideError(f"`{plain(name)}` is not a valid file name on every system")
        if len(part.encode("utf-8", "surrogatepass")) > LONGEST_PART:
            raise OutsideError(f"a part of `{plain(name)}` is longer than {LONGEST_PART} bytes")
    return parts


def require_ending(name: str, endings: tuple[str, ...]) -> None:
    """Raise DefinitionError unless `name` has one of the `endings`, in lower case with their dots."""
    if not name.lower().endswith(endings):
        raise DefinitionError(f"`{plain(name)}` must end in one of {', '.join(endings)}")
