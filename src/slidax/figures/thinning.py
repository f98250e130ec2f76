"""Fewer points for the same figure."""

from __future__ import annotations

import numpy as np

HEIGHTS = 450
"""A curve may be off by this fraction of its panel's height: less than half its line width."""


def thinned(
    x: np.ndarray, y: np.ndarray, columns: int = 280, limits: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The visible points of a curve in a figure: the first, last, lowest and highest of each column.

    No peak is lost. With known axis limits, points on a straight line between others are removed, too.

    - `x`: increasing [k].
    - `y`: values as the axis shows them, that is, logarithms on a logarithmic axis [k].
    - `columns`: of the figure.
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
    """Index of the first sample in each non-empty one of `columns`; `t` is increasing [k]."""
    column = np.minimum(((t - t[0]) * (columns / (t[-1] - t[0]))).astype(int), columns - 1)
    return np.flatnonzero(np.diff(column, prepend=-1))


def every_nth(points: np.ndarray, most: int = 160) -> np.ndarray:
    """About `most` of the `points` (along the first axis) of a smooth curve, with the first and the last."""
    chosen = np.unique(np.linspace(0, len(points) - 1, min(most, len(points))).round().astype(int))
    return points[chosen]


def off_lines(points: np.ndarray, tolerance: float) -> np.ndarray:
    """True for the `points` [k 2] that lines through the others miss by more than the `tolerance` [k].

    Douglas and Peucker's algorithm (1973).
    """
    keep = np.zeros(len(points), bool)
    keep[[0, -1]] = True
    open_ends = [(0, len(points) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        offsets, line = points[first + 1 : last] - points[first], points[last] - points[first]
        share = np.clip(offsets @ line / max(float(line @ line), 1e-300), 0.0, 1.0)
        distance = np.linalg.norm(offsets - share[:, None] * line, axis=1)
        farthest = int(np.argmax(distance))
        if distance[farthest] > tolerance:
            middle = first + 1 + farthest
            keep[middle] = True
            open_ends += [(first, middle), (middle, last)]
    return keep


def _off_lines(x: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """True for points that a line through the others misses by more than the tolerance [k]."""
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
