"""Docstrings as comments in C."""

from __future__ import annotations

import re

from slidax.codegen.naming import plain


def comment(text: str) -> str:
    """Return a text in ASCII that neither begins nor ends a C comment."""
    return plain(text.replace("`", "")).replace("*/", "* /").replace("/*", "/ *")


def shortened(text: str, most: int) -> str:
    """Return the first sentence of a line, cut between its parts if it has more than `most` letters."""
    first = re.split(r"(?<!eq)(?<!eqs)\.(?: |$)", text, maxsplit=1)[0]
    if len(first) <= most:
        return first
    cut = max(first.rfind(mark, 0, most) for mark in (", ", "; ", ": "))
    return first[: cut if cut > 0 else most].rstrip(" ,;:")
