"""Fewer points for the same picture."""

from __future__ import annotations

import numpy as np

HEIGHTS = 450
"""A curve may be off by one part in so many of its panel's height: less than half the width of its line."""


def thinned(
    x: np.ndarray, y: np.ndarray, columns: int = 280, limits: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The points that a picture of so many columns can show: in each the first, last, lowest and highest one.

    No peak is lost, unlike with every k-th point. If the limits of the axis are known, those points go too that lie on
    a line between others, as far as eyes can tell.

    - `x`: increasing [k].
    - `y`: values as the axis shows them, logarithms on a logarithmic one, [k].
    - `columns`: how many columns the picture has.
    - `limits`: of the axis.
    """
    if len(x) > 4 * columns:
        starts = column_starts(x, columns)
        ends = np.append(starts[1:], len(x))
        keep = [starts, ends - 1]
        for pick in (np.argmin, np.argmax):
            keep.append(np.array([start + int(pick(y[start:end])) for start, end in zip(starts, ends, strict=True)]))
        chosen = np.unique(np.concatenate(keep))
        x, y = x[chosen], y[chosen]
    if limits is not None:
        kept = _off_lines(x, y, (limits[1] - limits[0]) / HEIGHTS)
        x, y = x[kept], y[kept]
    return x, y


def column_starts(t: np.ndarray, columns: int) -> np.ndarray:
    """The number of the first sample in each column that has any.

    - `t`: increasing [k].
    - `columns`: how many there are.
    """
    column = np.minimum(((t - t[0]) * (columns / (t[-1] - t[0]))).astype(int), columns - 1)
    return np.flatnonzero(np.diff(column, prepend=-1))


def every_nth(points: np.ndarray, most: int = 160) -> np.ndarray:
    """About `most` of the points of a smooth curve, with the first and the last.

    - `points`: the curve, its points along the first axis.
    - `most`: how many to keep.
    """
    chosen = np.unique(np.linspace(0, len(points) - 1, min(most, len(points))).round().astype(int))
    return points[chosen]


def _off_lines(x: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """Which points a line through the others misses by more than the tolerance, [k]."""
    keep = np.zeros(len(x), bool)
    keep[[0, -1]] = True
    open_ends = [(0, len(x) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        off = np.abs(y[inner] - np.interp(x[inner], x[[first, last]], y[[first, last]]))
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            open_ends += [(first, middle), (middle, last)]
    return keep
