"""Searches with several aims under a condition, and their Pareto front."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slidax.core.errors import DefinitionError, short_repr

from .search import Island, population, require_budget, require_cmaes


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


def thin_front(aims: np.ndarray, most: int, first: int = 0) -> np.ndarray:
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


SIZE = 0.2
"""The first standard deviation of an island."""

DIRECTIONS = 6
"""Least number of weights."""

SLACK = 0.05
"""Offset below the best known aims, in logarithms, so that every aim weighs something."""


@dataclass(frozen=True)
class FrontEvaluation:
    """Aims and conditions of points.

    - `aims`: positive, the lower the better [points aims].
    - `broken`: by how much the condition is not held; <= 0 where it holds [points].
    """

    aims: np.ndarray
    broken: np.ndarray


Evaluator = Callable[[np.ndarray], FrontEvaluation]
"""From points of the unit cube [points dimension] to what they are worth."""


def pareto_search(
    judge: Evaluator,
    dimension: int,
    *,
    evaluations: int,
    start: np.ndarray | None = None,
    seed: int = 0,
    seconds: float | None = None,
    most: int = 25,
) -> Front:
    """The points that hold the condition and are not dominated, by one CMA-ES for each of several weights.

    Each searches for the least of a weighted Chebyshev norm of the aims,

        maxᵢ wᵢ (log fᵢ - log fᵢ*) + 0.05 Σᵢ wᵢ (log fᵢ - log fᵢ*),  fᵢ* the best seen that holds the condition

    (V. J. Bowman, 1976; the sum keeps it from points that are only just not dominated). If the start holds the
    condition, one more searches for the least `maxᵢ (log fᵢ - log fᵢ(start))`: to be better than it in all aims. A
    point that breaks the condition is worse than any that holds it, the more the more it is broken. The points of all
    are judged in one batch; one that has settled begins again from the point that is best for its weights.

    - `judge`: from points [points dimension] to their aims and whether the condition holds.
    - `dimension`: of the cube.
    - `evaluations`: how many points at most.
    - `start`: where the search begins, such as the gains of today [dimension]; the middle if None.
    - `seed`: of all that is random.
    - `seconds`: no batch begins after so many; None: any number.
    - `most`: how many points of the front are given.

    Raises DefinitionError if there is nothing to search, or `cmaes` is not installed.
    """
    require_budget(dimension, evaluations)
    require_cmaes()
    begin = np.full(dimension, 0.5) if start is None else np.asarray(start, float)
    if begin.shape != (dimension,) or np.any((begin < 0.0) | (begin > 1.0)):
        raise DefinitionError(
            f"`start` must be a point of the unit cube of dimension {dimension}; got {short_repr(begin)}"
        )
    archive = _Archive(judge, evaluations, seconds)
    archive.ask(begin[None])
    weights: list[np.ndarray | None] = [*_weights(archive.aims.shape[1], DIRECTIONS)]
    if archive.holds[0]:
        weights.append(None)
    seeds = iter(np.random.SeedSequence(seed).generate_state(10_000))
    size = population(dimension)
    islands = [Island(begin, SIZE, size, int(next(seeds))) for _ in weights]
    while not archive.over:
        request = [island.ask() for island in islands]
        places = archive.ask(np.concatenate(request)).reshape(len(islands), size)
        for k, weight in enumerate(weights):
            islands[k].tell(archive.scalar(weight)[places[k]])
            if islands[k].settled:
                again = archive.points[int(np.argmin(archive.scalar(weight)))]
                islands[k] = Island(again, SIZE / 2.0, size, int(next(seeds)))
    return archive.front(most)


class _Archive:
    """All points that were judged."""

    def __init__(self, judge: Evaluator, evaluations: int, seconds: float | None) -> None:
        self._judge = judge
        self._most = evaluations
        self._until = None if seconds is None else time.monotonic() + seconds
        self.points = self.aims = np.empty((0, 0))
        self.broken = np.empty(0)

    @property
    def over(self) -> bool:
        late = self._until is not None and time.monotonic() >= self._until
        return late or len(self.points) >= self._most

    def ask(self, points: np.ndarray) -> np.ndarray:
        """The places of what was judged; a point beyond the budget gets that of the last."""
        first, wanted = len(self.points), np.clip(points[: self._most - len(self.points)], 0.0, 1.0)
        judged = self._judge(wanted)
        if len(judged.aims) != len(wanted) or len(judged.broken) != len(wanted):
            raise DefinitionError(f"{len(wanted)} points were asked for; got {len(judged.aims)}")
        known = np.isfinite(judged.aims).all(axis=1) & (judged.aims > 0.0).all(axis=1) & ~np.isnan(judged.broken)
        broken = np.where(known, judged.broken, np.inf)
        if first == 0:
            self.points, self.aims, self.broken = wanted, judged.aims, broken
        else:
            self.points = np.concatenate([self.points, wanted])
            self.aims = np.concatenate([self.aims, judged.aims])
            self.broken = np.concatenate([self.broken, broken])
        return np.minimum(first + np.arange(len(points)), len(self.points) - 1)

    @property
    def holds(self) -> np.ndarray:
        return np.asarray(self.broken <= 0.0)

    def scalar(self, weight: np.ndarray | None) -> np.ndarray:
        """One number for each point, for one weight; beside the start for None."""
        holds = self.holds
        value = np.where(np.isfinite(self.broken), 1e6 + self.broken, np.inf)
        if holds.any():
            logs = np.log(self.aims[holds])
            ideal = logs.min(axis=0) - SLACK
            above = logs - np.log(self.aims[0]) if weight is None else weight * (logs - ideal)
            value[holds] = above.max(axis=1) + 0.05 * above.sum(axis=1)
        return value

    def front(self, most: int) -> Front:
        holding = np.flatnonzero(self.holds)
        chosen = holding[non_dominated(self.aims[holding])] if holding.size else holding
        if chosen.size:
            chosen = chosen[np.argsort(self.aims[chosen, 0], kind="stable")]
            reference = self.aims[0] if self.holds[0] else self.aims[chosen].min(axis=0)
            best = int(np.argmin(np.max(self.aims[chosen] / reference, axis=1)))
            chosen = chosen[thin_front(self.aims[chosen], most, best)]
        start = self.aims[0] if self.holds[0] else None
        return Front(self.points[chosen], self.aims[chosen], start, len(self.points), int(holding.size))


def _weights(aims: int, least: int) -> np.ndarray:
    """Spread evenly over the simplex (I. Das, J. E. Dennis, SIAM J. Optim. 8, 1998), none of them 0 [weights aims]."""
    if aims == 1:
        return np.ones((1, 1))
    for parts in itertools.count(1):
        result = [w for w in itertools.product(range(parts + 1), repeat=aims) if sum(w) == parts]
        if len(result) >= least:
            break
    weights = np.maximum(np.array(result, float) / parts, 0.05)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
