"""Result of a search, and the choice of distinct minima."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Stop = Literal["evaluations", "seconds", "enough", "settled"]
"""Reason for the end of a search: its budget, its time, a value low enough, or islands that have all settled."""


@dataclass(frozen=True)
class Found:
    """The lowest points of a function that a search has seen.

    - `points`: the lowest first, each apart from those before it [found dimension].
    - `values`: of them [found].
    - `evaluations`: how many points were asked for, in all.
    - `history`: after so many evaluations, so low a value [looks 2].
    - `stop`: what ended it.
    """

    points: np.ndarray
    values: np.ndarray
    evaluations: int
    history: np.ndarray
    stop: Stop


def apart(points: np.ndarray, values: np.ndarray, count: int, distance: float) -> np.ndarray:
    """Places of the lowest points, each apart from all that are lower: different cases and not one case many times.

    - `points`: of the unit cube [points dimension].
    - `values`: of them [points].
    - `count`: how many at most.
    - `distance`: by which at least one coordinate must differ.
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
