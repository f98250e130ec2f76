"""Labels beside curves, where they lie on no line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

SIZE = 7.0
"""Of the type [pt]."""


@dataclass(frozen=True)
class Label:
    """What a curve is called.

    - `text`: a few characters.
    - `places`: points of the curve, any of which it may stand beside, in the axes' own numbers.
    - `color`: of the curve.
    """

    text: str
    places: Sequence[tuple[float, float]]
    color: str


def place(axes: Axes, labels: Sequence[Label]) -> None:
    """Writes each label where it covers the least of all lines, marks and other labels, and near its curve.

    - `axes`: with all that is drawn, and laid out.
    - `labels`: what to write.
    """
    scale = 72.0 / axes.figure.dpi
    drawn = np.concatenate([_points(line) * scale for line in axes.lines])
    low, high = (axes.transAxes.transform(corner) * scale for corner in ((0, 0), (1, 1)))
    taken: list[np.ndarray] = []
    for label in labels:
        half = np.array([0.27 * SIZE * len(label.text) + 1.0, 0.42 * SIZE + 1.0])
        best = None
        for rank, at in enumerate(label.places):
            start = axes.transData.transform(at) * scale
            for distance in (4.0, 7.0, 11.0, 15.0):
                for angle in np.arange(24) * np.pi / 12:
                    way = np.array([np.cos(angle), np.sin(angle)])
                    middle = start + way * (distance + np.abs(way) @ half)
                    covered = int((np.abs(drawn - middle) < half).all(axis=1).sum())
                    met = sum(bool((np.abs(other - middle) < 2 * half).all()) for other in taken)
                    off = bool((middle - half < low).any() or (middle + half > high).any())
                    cost = 10 * covered + 500 * (met + off) + distance + 2 * rank
                    if best is None or cost < best[0]:
                        best = (cost, at, middle, middle - start)
        if best is not None:
            _, at, middle, offset = best
            taken.append(middle)
            axes.annotate(
                label.text,
                at,
                tuple(offset),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=SIZE,
                color=label.color,
                in_layout=False,
            )


def _points(line: Line2D) -> np.ndarray:
    """Points about a pixel apart along a line, as they are on the picture."""
    corners = line.get_transform().transform(line.get_xydata())
    if len(corners) < 2 or line.get_linestyle() == "None":
        return corners
    steps = (np.linspace(first, last, 2 + int(np.hypot(*(last - first)))) for first, last in pairwise(corners))
    return np.concatenate(list(steps))
