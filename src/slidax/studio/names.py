"""Names of files as a browser sends them: what may be one, on any system."""

from __future__ import annotations

import re

from slidax._errors import DefinitionError, plain

LONGEST, LONGEST_PART = 1024, 255
"""Characters of a name, and bytes of one of its parts."""

DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
"""What Windows takes for a device, in any folder."""

WRITTEN = (".yaml", ".yml", ".json", ".jsonl", ".csv", ".parquet", ".mcap", ".urdf", ".xml", ".mjcf")
"""Endings of files that are written; nothing among them is run by anything."""

READ = (*WRITTEN, ".html", ".svg", ".md", ".c", ".h", ".txt", ".png")
"""Endings of files that are shown or taken."""


class OutsideError(DefinitionError):
    """A name that leads out of the studio's folder, or is none of a file there."""


def parts_of(name: str) -> tuple[str, ...]:
    """The parts of a name below the folder.

    - `name`: with `/` between folders and file.

    Raises OutsideError if it is absolute, goes up, is hidden, or would be something else on another system.
    """
    if not isinstance(name, str) or not name or len(name) > LONGEST:
        raise OutsideError(f"a file's name must have 1 to {LONGEST} characters")
    if any(not one.isprintable() for one in name) or any(one in name for one in '\\:*?"<>|'):
        raise OutsideError(f"`{plain(name)}` has a character that is in no file's name everywhere")
    parts = tuple(name.split("/"))
    for part in parts:
        if not part or part in (".", ".."):
            raise OutsideError(f"`{plain(name)}` must be below the folder: no `..`, no `/` at its beginning")
        if part.startswith((".", "~", "-")):
            raise OutsideError(f"`{plain(name)}` is hidden, a home, or like an option: give it another name")
        if part.endswith((" ", ".")) or part.startswith(" ") or DEVICES.fullmatch(part):
            raise OutsideError(f"`{plain(name)}` is no file's name on every system")
        if len(part.encode("utf-8", "surrogatepass")) > LONGEST_PART:
            raise OutsideError(f"a part of `{plain(name)}` is longer than {LONGEST_PART} bytes")
    return parts


def require_ending(name: str, endings: tuple[str, ...]) -> None:
    """Raises DefinitionError unless a name has one of these endings.

    - `name`: of a file.
    - `endings`: in small letters, with their dots.
    """
    if not name.lower().endswith(endings):
        raise DefinitionError(f"`{plain(name)}` must end in one of {', '.join(endings)}")
