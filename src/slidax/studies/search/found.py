"""Result of a search, and the choice of distinct minima."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Stop = Literal["evaluations", "seconds", "enough", "settled"]
"""Reason for the end of a search: its budget, its time, a value low enough, or islands that have all settled."""


@dataclass(frozen=True)
class Found:
    """The lowest points of a search.

    - `points`: the lowest first, each at a distance from those before it [points dimension].
    - `values`: their values [points].
    - `evaluations`: number of evaluated points.
    - `history`: number of evaluations, and lowest value so far [batches 2].
    - `stop`: reason for the end of the search.
    """

    points: np.ndarray
    values: np.ndarray
    evaluations: int
    history: np.ndarray
    stop: Stop


def apart(points: np.ndarray, values: np.ndarray, count: int, distance: float) -> np.ndarray:
    """Indices of the lowest points, each at a distance from all lower ones, so that they are different cases.

    - `points`: of the unit cube [points dimension].
    - `values`: their values [points].
    - `count`: largest number of points.
    - `distance`: least difference in one coordinate.
    """
    chosen: list[int] = []
    left = np.ones(len(values), bool)
    for place in np.argsort(values, kind="stable"):
        if not left[place]:
            continue
        chosen.append(int(place))
        if len(chosen) == count:
            break
        left &= np.max(np.abs(points - points[place]), axis=1) >= distance
    return np.array(chosen, int)
