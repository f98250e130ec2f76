"""Docstrings as comments in C."""

from __future__ import annotations

import re

from slidax.codegen.naming import plain


def comment(text: str) -> str:
    """A text in ASCII, with nothing in it that begins or ends a comment.

    - `text`: any.
    """
    return plain(text.replace("`", "")).replace("*/", "* /").replace("/*", "/ *")


def shortened(text: str, most: int) -> str:
    """The first sentence of a text, cut between its parts if it is longer than that.

    - `text`: one line.
    - `most`: how many letters.
    """
    first = re.split(r"(?<!eq)(?<!eqs)\.(?: |$)", text, maxsplit=1)[0]
    if len(first) <= most:
        return first
    cut = max(first.rfind(mark, 0, most) for mark in (", ", "; ", ": "))
    return first[: cut if cut > 0 else most].rstrip(" ,;:")
