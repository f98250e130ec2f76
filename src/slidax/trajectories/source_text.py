"""The text of a file, or text given as such."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from slidax._files import read_text


def source_text(source: str | Path, is_text: Callable[[str], bool]) -> tuple[str, str]:
    """What to call it in messages, and the text.

    - `source`: a path, or the text itself.
    - `is_text`: says of a string whether it is the text itself.

    Raises DefinitionError if there is no such file or it is not text.
    """
    if isinstance(source, str) and is_text(source):
        return "the text", source.removeprefix("\ufeff")
    path = Path(source)
    return f"`{path.name}`", read_text(path)
