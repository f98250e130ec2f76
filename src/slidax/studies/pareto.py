"""Constrained search with several objectives, and its Pareto front."""

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
    """Pareto front: feasible points that no other evaluated point dominates.

    - `points`: the points, sorted by the first objective [front dimension].
    - `aims`: objectives of each point, lower is better [front aims].
    - `start`: objectives at the start of the search [aims]; None if the start is infeasible.
    - `evaluations`: number of evaluated points.
    - `holding`: number of feasible points.
    """

    points: np.ndarray
    aims: np.ndarray
    start: np.ndarray | None
    evaluations: int
    holding: int


def non_dominated(aims: np.ndarray) -> np.ndarray:
    """Return a mask of the rows that no other row dominates; of equal rows, only the first [rows].

    - `aims`: objectives, lower is better, all finite [rows aims].
    """
    order = np.lexsort(aims.T[::-1])
    kept: list[int] = []
    for row in order:
        if not kept or not np.any(np.all(aims[kept] <= aims[row], axis=1)):
            kept.append(int(row))
    chosen = np.zeros(len(aims), bool)
    chosen[kept] = True
    return chosen


def thin_front(aims: np.ndarray, most: int, first: int = 0) -> np.ndarray:
    """Return the indices of selected rows of a front: the best in each objective, and others far from each other.

    - `aims`: objectives of the front [rows aims].
    - `most`: largest number of rows to select.
    - `first`: index of a row that is always selected.
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
"""Initial standard deviation of each CMA-ES."""

DIRECTIONS = 6
"""Least number of weight vectors, and so of CMA-ES."""

SLACK = 0.05
"""Offset subtracted from the logarithms of the best known objectives, so that every objective counts."""


@dataclass(frozen=True)
class FrontEvaluation:
    """Objectives and constraint violations of points.

    - `aims`: positive objectives, lower is better [points aims].
    - `broken`: constraint violation; <= 0 at feasible points [points].
    """

    aims: np.ndarray
    broken: np.ndarray


Evaluator = Callable[[np.ndarray], FrontEvaluation]
"""Maps points of the unit cube [points dimension] to their objectives and violations."""


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
    """Search for the Pareto front with a CMA-ES for each of several weight vectors.

    Each CMA-ES minimises a weighted Chebyshev norm of the objectives fᵢ,

        maxᵢ wᵢ (log fᵢ - zᵢ) + 0.05 Σᵢ wᵢ (log fᵢ - zᵢ),  zᵢ = log fᵢ* - 0.05

    with the weights wᵢ and the best feasible value fᵢ* so far (V. J. Bowman, 1976). The sum avoids weakly dominated
    points. If the start is feasible, another CMA-ES minimises this norm for wᵢ = 1 and zᵢ = log fᵢ(start). It searches
    for points that are better than the start in all objectives.

    An infeasible point is worse than every feasible point, and a larger violation is worse. The points of all CMA-ES
    are evaluated in a single batch. A CMA-ES that has converged restarts at the best point for its weights.

    - `judge`: returns objectives and constraint violations of points [points dimension].
    - `dimension`: dimension of the cube.
    - `evaluations`: largest number of points.
    - `start`: start of the search, such as the current gains [dimension]; the middle if None.
    - `seed`: seed of the random numbers.
    - `seconds`: time limit after which no batch begins [s]; None for no limit.
    - `most`: largest number of points of the returned front.

    Raises DefinitionError if the dimension or the budget is less than 1, `start` is not a point of the cube, or `cmaes`
    is not installed.
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
        indices = archive.ask(np.concatenate(request)).reshape(len(islands), size)
        for k, weight in enumerate(weights):
            islands[k].tell(archive.scalar(weight)[indices[k]])
            if islands[k].settled:
                again = archive.points[int(np.argmin(archive.scalar(weight)))]
                islands[k] = Island(again, SIZE / 2.0, size, int(next(seeds)))
    return archive.front(most)


class _Archive:
    """All evaluated points."""

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
        """Evaluate points and return their indices; points beyond the budget get the index of the last."""
        first, wanted = len(self.points), np.clip(points[: self._most - len(self.points)], 0.0, 1.0)
        judged = self._judge(wanted)
        if len(judged.aims) != len(wanted) or len(judged.broken) != len(wanted):
            raise DefinitionError(f"`judge` must evaluate all {len(wanted)} points; got {len(judged.aims)} evaluations")
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
        """Return the scalar objective of each point for a weight vector; for None, relative to the start."""
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
    """Return evenly spread positive weights of sum 1 (I. Das, J. E. Dennis, SIAM J. Optim. 8, 1998) [weights aims]."""
    if aims == 1:
        return np.ones((1, 1))
    for parts in itertools.count(1):
        result = [w for w in itertools.product(range(parts + 1), repeat=aims) if sum(w) == parts]
        if len(result) >= least:
            break
    weights = np.maximum(np.array(result, float) / parts, 0.05)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
