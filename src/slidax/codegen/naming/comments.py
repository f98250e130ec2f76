"""A line on what a value is part of: the formula that the docstring of its function begins with."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

from .plain_text import plain
from .sources import source


def about(frames: Sequence[Any]) -> str:
    """The innermost function around a value whose docstring begins with a formula, and that formula; empty if none.

    A method's docstring, or that of its class if it says more.

    - `frames`: places in the source, the innermost first.
    """
    for frame in frames:
        text = _about(frame.file, frame.line)
        if text:
            return text
    return ""


@functools.lru_cache(4096)
def _about(file: str, line: int) -> str:
    text = source(file)
    docs = None if text is None else text.docs(line)
    if docs is None:
        return ""
    # Of two that say as much the method's own is told.
    told = max([(docs.name, docs.summary), (docs.owner, docs.owner_summary)], key=lambda of: _formulas(of[1]))
    if not _formulas(told[1]):
        return ""
    return f"{told[0].removesuffix('.__call__')}: {plain(told[1]).replace('`', '').rstrip('.')}"


def _formulas(summary: str) -> int:
    formulas = "".join(summary.split("`")[1::2])
    return bool(formulas) + ("=" in formulas) + ("eq. (" in summary or "qs. (" in summary)
