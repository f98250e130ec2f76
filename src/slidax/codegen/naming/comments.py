"""Comments on values: the formula at the beginning of a function's docstring."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

from .plain_text import plain
from .sources import source


def about(frames: Sequence[Any]) -> str:
    """Name and formula of the innermost function whose docstring begins with a formula; empty if there is none.

    A class's docstring is preferred to a method's if it has more of a formula.

    - `frames`: places in the source, the innermost first.
    """
    return next(filter(None, (_about(frame.file, frame.line) for frame in frames)), "")


@functools.lru_cache(4096)
def _about(file: str, line: int) -> str:
    text = source(file)
    docs = None if text is None else text.docs(line)
    if docs is None:
        return ""
    # The method comes first, and wins a tie.
    name, summary = max([(docs.name, docs.summary), (docs.owner, docs.owner_summary)], key=lambda of: _formulas(of[1]))
    if not _formulas(summary):
        return ""
    return f"{name.removesuffix('.__call__')}: {plain(summary).replace('`', '').rstrip('.')}"


def _formulas(summary: str) -> int:
    formulas = "".join(summary.split("`")[1::2])
    return bool(formulas) + ("=" in formulas) + ("eq. (" in summary or "qs. (" in summary)
