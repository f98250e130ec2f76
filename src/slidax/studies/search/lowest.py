"""Global minimisation on the unit cube: spread points, then CMA-ES from the best of them, then quasi-Newton steps."""

from __future__ import annotations

import numpy as np

from .found import Found, Stop, apart
from .island import Island, population, require_cmaes
from .refine import refine
from .seen import Objective, Seen, require_budget
from .spread import spread

FIRST = 0.3
"""Largest share of the budget for the spread points."""

LAST = 0.1
"""Share of the budget that is reserved for the quasi-Newton steps."""

SIZE = 0.15
"""The first standard deviation of an island."""


def lowest(
    objective: Objective,
    dimension: int,
    *,
    evaluations: int,
    seed: int = 0,
    seconds: float | None = None,
    enough: float | None = None,
    islands: int = 4,
    keep: int = 5,
    distance: float = 0.2,
    settled: float = 1e-7,
) -> Found:
    """The lowest points of a function on the unit cube, by batches.

    A third of the budget, at most 2048 points, is spread over the cube. Several CMA-ES islands start at the best of
    these points that are distant from each other. Each batch contains the points of all islands. An island that has
    settled restarts with twice as many points, at the lowest point that is distant from all settled islands. The rest
    of the budget goes to quasi-Newton steps with finite differences from the lowest points.

    The same seed gives the same points, unless the time ends the search.

    - `objective`: function of points [points dimension] to values [points]; nonfinite values count as +∞.
    - `evaluations`: largest number of points.
    - `seconds`: no batch begins after so many; None: any number.
    - `enough`: the search ends below this value; None: no such value.
    - `islands`: number of CMA-ES islands.
    - `keep`, `distance`: number of returned points, and the least difference in one of their coordinates.
    - `settled`: an island has settled if the values of a generation differ by less than this.

    Raises DefinitionError if the dimension or the budget is less than 1, or `cmaes` is not installed.
    """
    require_budget(dimension, evaluations)
    require_cmaes()
    known = Seen(objective, evaluations, seconds, enough)
    count = min(2048, max(population(dimension), int(FIRST * evaluations)))
    batch = islands * population(dimension)
    first = spread(dimension, count, seed=seed)
    for begin in range(0, count, max(batch, 256)):
        if known.over:
            break
        known.ask(first[begin : begin + max(batch, 256)])
    stop = known.over or _by_islands(known, dimension, seed, islands, distance, settled, int(LAST * evaluations))
    if stop == "settled":
        points, values = known.all
        for place in apart(points, values, islands, distance):
            stop = known.over or stop
            if stop != "settled":
                break
            refine(known, points[place])
        stop = known.over or stop
    return known.result(keep, distance, stop)


def _by_islands(
    known: Seen, dimension: int, seed: int, islands: int, distance: float, settled: float, reserve: int
) -> Stop:
    """Search by islands; return "settled" when only the reserve is left."""
    seeds = iter(np.random.SeedSequence(seed).generate_state(10_000))
    size = population(dimension)
    points, values = known.all
    starts = [points[place] for place in apart(points, values, islands, distance)]
    at_work = [(Island(start, SIZE, size, int(next(seeds))), start, size) for start in starts]
    ended: list[np.ndarray] = []
    while known.left > reserve:
        if known.over:
            return known.over
        request = [island.ask() for island, *_ in at_work]
        told = np.split(known.ask(np.concatenate(request)), np.cumsum([len(a) for a in request])[:-1])
        for k, (island, start, points_each) in enumerate(at_work):
            island.tell(told[k])
            low = request[k][int(np.argmin(told[k]))]
            finite = told[k][np.isfinite(told[k])]
            if island.settled or (finite.size > 1 and np.ptp(finite) <= settled):
                ended += [start, np.clip(low, 0.0, 1.0)]
                again = _elsewhere(known, ended, distance)
                at_work[k] = Island(again, SIZE, 2 * points_each, int(next(seeds))), again, 2 * points_each
    return known.over or "settled"


def _elsewhere(known: Seen, ended: list[np.ndarray], distance: float) -> np.ndarray:
    """The lowest point that is distant from all settled islands; the lowest of all if there is none."""
    points, values = known.all
    far = np.ones(len(values), bool)
    for place in ended:
        far &= np.max(np.abs(points - place), axis=1) >= distance
    chosen = np.where(far, values, np.inf) if np.isfinite(values[far]).any() else values
    return np.asarray(points[int(np.argmin(chosen))])
