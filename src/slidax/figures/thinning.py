"""Fewer points for the same picture."""

from __future__ import annotations

import numpy as np


def thinned(x: np.ndarray, y: np.ndarray, columns: int = 280) -> tuple[np.ndarray, np.ndarray]:
    """The points that a picture of so many columns can show: in each the first, last, lowest and highest one.

    No peak is lost, unlike with every k-th point.

    - `x`: increasing [k].
    - `y`: values [k].
    - `columns`: how many columns the picture has.
    """
    if len(x) <= 4 * columns:
        return x, y
    column = np.minimum(((x - x[0]) * (columns / (x[-1] - x[0]))).astype(int), columns - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    ends = np.append(starts[1:], len(x))
    keep = [starts, ends - 1]
    for pick in (np.argmin, np.argmax):
        keep.append(np.array([start + int(pick(y[start:end])) for start, end in zip(starts, ends, strict=True)]))
    chosen = np.unique(np.concatenate(keep))
    return x[chosen], y[chosen]


def every_nth(points: np.ndarray, most: int = 160) -> np.ndarray:
    """About `most` of the points of a smooth curve, with the first and the last.

    - `points`: the curve, its points along the first axis.
    - `most`: how many to keep.
    """
    chosen = np.unique(np.linspace(0, len(points) - 1, min(most, len(points))).round().astype(int))
    kept: np.ndarray = points[chosen]
    return kept
