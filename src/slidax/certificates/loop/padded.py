"""Arrays of one length, so that all initial sets of a bound share one compiled program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np


def padded(values: Any, count: int) -> Any:
    """Return an array with its last row repeated up to `count` rows; longer arrays are unchanged."""
    rows = np.asarray(values)
    return np.concatenate([rows, np.repeat(rows[-1:], max(count - len(rows), 0), axis=0)])


def of_rows(compiled: Callable[..., Any], rows: Any, most: int, *arguments: Any) -> Any:
    """Apply a compiled function to padded rows; outputs are NumPy arrays with the row as first axis.

    - `compiled`: from `arguments` and all rows to a tree of arrays of the same length.
    - `most`: largest number of rows of all calls that share the program.
    """
    return jax.tree.map(lambda output: np.asarray(output)[: len(rows)], compiled(*arguments, padded(rows, most)))
