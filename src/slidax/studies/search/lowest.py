"""The lowest value in the unit cube: spread points, then CMA-ES from the best of them, then a quasi-Newton step."""

from __future__ import annotations

import numpy as np

from .found import Found, Stop, apart
from .island import Island, population, require_cmaes
from .refine import refine
from .seen import Objective, Seen, require_budget
from .spread import spread

FIRST = 0.3
"""The share of the budget that the spread points may take."""

LAST = 0.1
"""The share that is kept for the quasi-Newton steps."""

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

    A third of the budget, at most 2048 points, is spread over the cube. From the best of these that are apart from each
    other, several CMA-ES search at once, so that each batch holds the points of all of them. One that has settled
    begins again with twice as many points, at the lowest point that is apart from all places where one has settled.
    The rest of the budget goes to quasi-Newton steps from the lowest points, by finite differences; they are
    kept if they help.

    The same seed gives the same points, unless the time ends the search.

    - `objective`: from points [points dimension] to numbers [points]; one that is not finite is as high as can be.
    - `dimension`: of the cube.
    - `evaluations`: how many points at most.
    - `seed`: of all that is random.
    - `seconds`: no batch begins after so many; None: any number.
    - `enough`: the search ends below this; None: it goes on.
    - `islands`: how many CMA-ES at once.
    - `keep`, `distance`: how many of the lowest points are given, and by how much one of their coordinates differs.
    - `settled`: an island in whose generation all values are so near to each other has settled.

    Raises DefinitionError if there is nothing to search, or `cmaes` is not installed.
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
    """Ends as settled when only the reserve is left."""
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
    """The lowest point that is apart from where others ended; the lowest of all if there is none."""
    points, values = known.all
    far = np.ones(len(values), bool)
    for place in ended:
        far &= np.max(np.abs(points - place), axis=1) >= distance
    chosen = np.where(far, values, np.inf) if np.isfinite(values[far]).any() else values
    return np.asarray(points[int(np.argmin(chosen))])
