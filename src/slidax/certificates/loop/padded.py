"""Arrays of one length, so that all beginnings of a bound share what is compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np


def padded(values: Any, count: int) -> Any:
    """An array with its last row again and again, up to so many rows.

    - `values`: one row at least.
    - `count`: how many; fewer than there are leave it as it is.
    """
    given = np.asarray(values)
    return np.concatenate([given, np.repeat(given[-1:], max(count - len(given), 0), axis=0)])


def of_rows(compiled: Callable[..., Any], rows: Any, most: int, *given: Any) -> Any:
    """What a compiled function makes of rows, as NumPy's arrays, with the row as their first axis.

    - `compiled`: from `given` and all rows to a tree of arrays of as many.
    - `rows`: what it is called with.
    - `most`: rows that other calls may have, so that all share one program.
    - `given`: what it is called with before them.
    """
    return jax.tree.map(lambda one: np.asarray(one)[: len(rows)], compiled(*given, padded(rows, most)))
