"""Pareto fronts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Front:
    """Points of which none is at least as good as another in all aims and better in one.

    - `points`: in order of the first aim [front dimension].
    - `aims`: of each, the lower the better [front aims].
    - `start`: the aims at the point where the search began [aims]; None if its condition does not hold there.
    - `evaluations`: how many points were judged.
    - `holding`: at how many of them the condition holds.
    """

    points: np.ndarray
    aims: np.ndarray
    start: np.ndarray | None
    evaluations: int
    holding: int


def non_dominated(aims: np.ndarray) -> np.ndarray:
    """True for the rows that no other row dominates; of equal rows the first [rows].

    - `aims`: the lower the better, all finite [rows aims].
    """
    order = np.lexsort(aims.T[::-1])
    kept: list[int] = []
    for place in order:
        if not kept or not np.any(np.all(aims[kept] <= aims[place], axis=1)):
            kept.append(int(place))
    chosen = np.zeros(len(aims), bool)
    chosen[kept] = True
    return chosen


def thinned(aims: np.ndarray, most: int, first: int = 0) -> np.ndarray:
    """Places of so many rows of a front, the best in each aim among them, and the others far from each other.

    - `aims`: of the front [rows aims].
    - `most`: how many.
    - `first`: a row that is kept before all others.
    """
    if len(aims) <= most:
        return np.arange(len(aims))
    spans = np.ptp(aims, axis=0)
    scaled = aims / np.where(spans == 0.0, 1.0, spans)
    chosen = list(dict.fromkeys([first, *map(int, np.argmin(aims, axis=0))]))[:most]
    far = np.min(np.linalg.norm(scaled[:, None] - scaled[chosen], axis=2), axis=1)
    while len(chosen) < most:
        chosen.append(int(np.argmax(far)))
        far = np.minimum(far, np.linalg.norm(scaled - scaled[chosen[-1]], axis=1))
    return np.array(sorted(chosen, key=lambda k: float(aims[k, 0])))
