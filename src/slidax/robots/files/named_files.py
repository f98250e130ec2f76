"""Check of the files that a robot file names and MuJoCo opens by itself."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from slidax._errors import DefinitionError
from slidax._files import MEGABYTE, read_bytes, require_file

from .source import MOST_BYTES

MOST_OF_A_MESH = 200 * MEGABYTE
FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Attributes of `<compiler>` that name folders."""

PARTS = ("include", "model")
"""Elements that name robot files."""


def require_named_files(root: ET.Element, folder: Path) -> None:
    """Check the files that a MuJoCo file names, and those that its parts name.

    Reading a pipe or a device would never end. Missing files are left to MuJoCo's reader, which knows other places.

    Raises DefinitionError if a file exists but is no regular file, or is too large.
    """
    waiting, known = [root], set[Path]()
    while waiting:
        element = waiting.pop()
        named = [text for compiler in element.iter("compiler") for text in _folders(compiler)]
        folders = {folder, *(folder / text for text in named)}
        for part in element.iter():
            name = part.get("file")
            for path in () if not name else (place / name for place in folders):
                if path in known or not _exists(path):
                    continue
                known.add(path)
                if part.tag in PARTS:
                    waiting += _parsed_part(path)
                else:
                    require_file(path, f"the file of <{part.tag}>", most=MOST_OF_A_MESH)


def _folders(compiler: ET.Element) -> list[str]:
    return [text for name in FOLDERS if (text := compiler.get(name))]


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _parsed_part(path: Path) -> list[ET.Element]:
    """Outermost element of a part; none if MuJoCo's reader will reject it."""
    content = read_bytes(path, "the included file", most=MOST_BYTES)
    if b"<!DOCTYPE" in content:
        raise DefinitionError(f"the included file `{path}` has a DOCTYPE, which may define entities; remove it")
    try:
        return [ET.XML(content)]
    except (ET.ParseError, LookupError, ValueError):
        return []
