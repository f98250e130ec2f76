"""The text of a file, or text given as such."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from slidax._errors import DefinitionError


def source_text(source: str | Path, is_text: Callable[[str], bool]) -> tuple[str, str]:
    """What to call it in messages, and the text.

    - `source`: a path, or the text itself.
    - `is_text`: says of a string whether it is the text itself.

    Raises DefinitionError if there is no such file or it is not text.
    """
    if isinstance(source, str) and is_text(source):
        return "the text", source.removeprefix("\ufeff")
    path = Path(source)
    try:
        # With its byte order mark, if spreadsheet programs have put one there.
        return f"`{path.name}`", path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None
