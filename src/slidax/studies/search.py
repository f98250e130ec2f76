"""Search for the lowest values on the unit cube: spread points, CMA-ES and quasi-Newton steps."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from slidax.core.errors import DefinitionError, short_repr

Stop = Literal["evaluations", "seconds", "enough", "settled"]
"""Reason for the end of a search: its budget, its time limit, a low enough value, or the end of all its steps."""


@dataclass(frozen=True)
class SearchResult:
    """The lowest points of a search.

    - `points`: the lowest first; any two differ by the requested distance in a coordinate [points dimension].
    - `values`: their values [points].
    - `evaluations`: number of evaluated points.
    - `history`: number of evaluations, and lowest value so far, after each batch [batches 2].
    - `stop`: reason for the end of the search.
    """

    points: np.ndarray
    values: np.ndarray
    evaluations: int
    history: np.ndarray
    stop: Stop


def distinct_minima(points: np.ndarray, values: np.ndarray, count: int, distance: float) -> np.ndarray:
    """Return the indices of the points with the lowest values, without neighbours of a lower point; lowest first.

    - `points`: points of the unit cube [points dimension].
    - `values`: their values [points].
    - `count`: largest number of returned points.
    - `distance`: any two returned points differ by at least this in one coordinate.
    """
    chosen: list[int] = []
    left = np.ones(len(values), bool)
    for index in np.argsort(values, kind="stable"):
        if not left[index]:
            continue
        chosen.append(int(index))
        if len(chosen) == count:
            break
        left &= np.max(np.abs(points - points[index]), axis=1) >= distance
    return np.array(chosen, int)


Objective = Callable[[np.ndarray], np.ndarray]
"""Maps points of the unit cube [points dimension] to the values to minimise [points]; nonfinite values count as +∞."""


class EvaluatedPoints:
    """Evaluates an objective within a budget, and records every point and value.

    - `objective`: maps points to the values to minimise.
    - `evaluations`: largest number of points.
    - `seconds`: time limit after which no batch begins [s]; None for no limit.
    - `enough`: value below which the search ends; None for no such value.
    """

    def __init__(self, objective: Objective, evaluations: int, seconds: float | None, enough: float | None) -> None:
        self._objective = objective
        self._most = evaluations
        self._until = None if seconds is None else time.monotonic() + seconds
        self._enough = enough
        self._points: list[np.ndarray] = []
        self._values: list[np.ndarray] = []
        self._history: list[tuple[int, float]] = []
        self.evaluations = 0
        self.lowest = np.inf

    @property
    def over(self) -> Stop | None:
        """Reason to end the search now; None to continue."""
        if self._enough is not None and self.lowest < self._enough:
            return "enough"
        if self.evaluations >= self._most:
            return "evaluations"
        if self._until is not None and time.monotonic() >= self._until:
            return "seconds"
        return None

    @property
    def left(self) -> int:
        """Number of remaining evaluations."""
        return self._most - self.evaluations

    def ask(self, points: np.ndarray) -> np.ndarray:
        """Evaluate points in a batch, and return their values [points]; +∞ for points beyond the budget.

        - `points`: points [points dimension], moved to the nearest point of the cube.

        Raises DefinitionError if the objective does not return a value for each point.
        """
        wanted = np.clip(points[: self.left], 0.0, 1.0)
        values = np.full(len(points), np.inf)
        if len(wanted):
            got = np.asarray(self._objective(wanted), float)
            if got.shape != (len(wanted),):
                raise DefinitionError(
                    f"an objective must return a value for each of {len(wanted)} points; got shape {got.shape}"
                )
            values[: len(wanted)] = np.where(np.isfinite(got), got, np.inf)
            self._points.append(wanted)
            self._values.append(values[: len(wanted)])
            self.evaluations += len(wanted)
            self.lowest = min(self.lowest, float(values.min()))
            self._history.append((self.evaluations, self.lowest))
        return values

    @property
    def all(self) -> tuple[np.ndarray, np.ndarray]:
        """Every point [points dimension] and its value [points]."""
        return np.concatenate(self._points), np.concatenate(self._values)

    def result(self, keep: int, distance: float, stop: Stop) -> SearchResult:
        """Return the lowest points.

        - `keep`: largest number of points.
        - `distance`: least difference of any two points in at least one coordinate.
        - `stop`: reason for the end of the search.
        """
        points, values = self.all
        chosen = distinct_minima(points, values, keep, distance)
        chosen = chosen[np.isfinite(values[chosen])]
        return SearchResult(points[chosen], values[chosen], self.evaluations, np.array(self._history), stop)


def require_budget(dimension: int, evaluations: int) -> None:
    """Raise DefinitionError if the cube's dimension or the number of evaluations is less than 1."""
    if dimension < 1:
        raise DefinitionError(f"a search needs at least one uncertain value; got {short_repr(dimension)}")
    if evaluations < 1:
        raise DefinitionError(f"a search needs at least one evaluation; got {short_repr(evaluations)}")


FAR = 10.0
"""Penalty of a point outside the cube, per squared distance, in units of the values' range."""


LANES = 8
"""Number of runs that the native engine computes in one SIMD vector."""


def population(dimension: int) -> int:
    """Return the number of points per generation of CMA-ES: its default, rounded up to a multiple of 8.

    - `dimension`: dimension of the cube.
    """
    return -(-(4 + math.floor(3 * math.log(dimension))) // LANES) * LANES


class Island:
    """CMA-ES (N. Hansen, A. Ostermeier, Evol. Comput. 9, 2001) in the unit cube, by the package `cmaes`.

    A point outside the cube gets the value of the nearest point inside plus a penalty that grows with the distance. So
    the search can reach the faces and corners, where worst cases often are.

    - `start`: initial mean [dimension].
    - `size`: initial standard deviation.
    - `points`: number of points per generation.
    - `seed`: seed of the random numbers.

    Raises DefinitionError if `cmaes` is not installed.
    """

    def __init__(self, start: np.ndarray, size: float, points: int, seed: int) -> None:
        cma = _cmaes().CMA
        self._search = cma(mean=np.array(start, float), sigma=size, seed=seed, population_size=points)
        self._points: list[np.ndarray] = []

    def ask(self) -> np.ndarray:
        """Return the points of the next generation [points dimension], possibly outside the cube."""
        self._points = [self._search.ask() for _ in range(self._search.population_size)]
        return np.array(self._points)

    def tell(self, values: np.ndarray) -> None:
        """Pass the values of the last generation to CMA-ES.

        - `values`: for each point of `ask`, the value of the nearest point inside the cube [points]; +∞ if it failed.
        """
        good = values[np.isfinite(values)]
        spread = float(np.ptp(good)) if good.size else 1.0
        worst = float(good.max()) if good.size else 0.0
        points = np.array(self._points)
        beyond = np.sum((points - np.clip(points, 0.0, 1.0)) ** 2, axis=1)
        penalised = np.where(np.isfinite(values), values, worst + (spread or 1.0)) + FAR * (spread or 1e-9) * beyond
        self._search.tell(list(zip(self._points, map(float, penalised), strict=True)))

    @property
    def settled(self) -> bool:
        """True if the island has converged."""
        return bool(self._search.should_stop())


def require_cmaes() -> None:
    """Raise DefinitionError if `cmaes` is not installed."""
    _cmaes()


def _cmaes() -> Any:
    try:
        import cmaes
    except ImportError:
        raise DefinitionError("a search needs cmaes, which is not installed: pip install 'slidax[studies]'") from None
    return cmaes


STEP = 1e-5
"""Step of the finite differences: its effect is far above rounding errors, and nearly linear."""

ITERATIONS = 10
"""Largest number of L-BFGS-B iterations; a nonsmooth function ends them earlier."""


def refine(evaluated: EvaluatedPoints, start: np.ndarray) -> None:
    """Descend from a point by L-BFGS-B (R. H. Byrd and others, SIAM J. Sci. Comput. 16, 1995).

    The gradient is by finite differences, whose points are evaluated in a batch. The lowest point is in `evaluated`.

    - `evaluated`: evaluates and records all points.
    - `start`: a point of the cube [dimension].
    """

    def value_and_slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        # Steps point inwards, so that all points are in the cube.
        steps = np.where(x < 0.5, STEP, -STEP)
        if evaluated.over or evaluated.left < x.size + 1:
            raise StopIteration
        values = evaluated.ask(np.concatenate([x[None], x + np.diag(steps)]))
        if not np.isfinite(values).all():
            raise StopIteration
        return float(values[0]), (values[1:] - values[0]) / steps

    try:
        minimize(
            value_and_slope,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, 1.0)] * start.size,
            options={"maxiter": ITERATIONS, "maxls": 8},
        )
    except StopIteration:
        return


CORNERS = 4
"""One in four of the first points is a corner of the cube, where worst cases often are."""


def spread_points(dimension: int, count: int, *, seed: int) -> np.ndarray:
    """Return points of the unit cube [count, dimension]: its middle, some corners, and a scrambled Sobol sequence.

    - `count`: number of points.
    - `seed`: seed for the scrambling and the choice of corners.
    """
    rng = np.random.default_rng(seed)
    middle = np.full((1, dimension), 0.5)
    chosen = _corners(dimension, count // CORNERS, rng)
    left = max(0, count - 1 - len(chosen))
    with warnings.catch_warnings(action="ignore"):
        # SciPy warns unless the number is a power of two, which only matters for integration.
        between = qmc.Sobol(dimension, rng=rng).random(left)
    return np.concatenate([middle, chosen, between])[:count]


def _corners(dimension: int, most: int, rng: np.random.Generator) -> np.ndarray:
    """Return all corners of the cube if there are at most `most`; otherwise `most` random corners."""
    if 2**dimension <= most:
        return (np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1).astype(float)
    return rng.integers(0, 2, (most, dimension)).astype(float)


FIRST = 0.3
"""Largest share of the budget for the spread points, with which a search begins."""

LAST = 0.1
"""Share of the budget that is reserved for the quasi-Newton steps."""

SIZE = 0.15
"""Initial standard deviation of an island."""

SETTLED = 1e-7
"""An island has settled if the values of a generation differ by at most this."""


def search_lowest(
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
) -> SearchResult:
    """Search for the lowest points of a function on the unit cube, in batches.

    First, 30 % of the budget is spread over the cube: at least a generation of CMA-ES, and at most 2048 points. Several
    CMA-ES searches, the islands, start at the best of these points that are distant from each other. Each batch
    contains the points of all islands. An island that has settled restarts with twice as many points, at the lowest
    point that is distant from all settled islands. The last 10 % of the budget goes to quasi-Newton steps with finite
    differences from the lowest points.

    The same seed gives the same points, unless the time limit ends the search.

    - `objective`: function of points [points dimension] to values [points]; nonfinite values count as +∞.
    - `dimension`: dimension of the cube.
    - `evaluations`: largest number of points.
    - `seconds`: time limit after which no batch begins [s]; None for no limit.
    - `enough`: value below which the search ends; None for no such value.
    - `islands`: number of CMA-ES islands.
    - `keep`: largest number of returned points.
    - `distance`: any two returned points differ by at least this in one coordinate.

    Raises DefinitionError if the dimension or the budget is less than 1, or `cmaes` is not installed.
    """
    require_budget(dimension, evaluations)
    require_cmaes()
    known = EvaluatedPoints(objective, evaluations, seconds, enough)
    count = min(2048, max(population(dimension), int(FIRST * evaluations)))
    batch = islands * population(dimension)
    first = spread_points(dimension, count, seed=seed)
    for begin in range(0, count, max(batch, 256)):
        if known.over:
            break
        known.ask(first[begin : begin + max(batch, 256)])
    stop = known.over or _search_by_islands(known, dimension, seed, islands, distance, int(LAST * evaluations))
    if stop == "settled":
        points, values = known.all
        for index in distinct_minima(points, values, islands, distance):
            stop = known.over or stop
            if stop != "settled":
                break
            refine(known, points[index])
        stop = known.over or stop
    return known.result(keep, distance, stop)


def _search_by_islands(
    known: EvaluatedPoints, dimension: int, seed: int, islands: int, distance: float, reserve: int
) -> Stop:
    """Search by islands until `reserve` evaluations are left, and return "settled", or the reason to end earlier."""
    seeds = iter(np.random.SeedSequence(seed).generate_state(10_000))
    size = population(dimension)
    points, values = known.all
    starts = [points[index] for index in distinct_minima(points, values, islands, distance)]
    active = [(Island(start, SIZE, size, int(next(seeds))), start, size) for start in starts]
    ended: list[np.ndarray] = []
    while known.left > reserve:
        if known.over:
            return known.over
        request = [island.ask() for island, *_ in active]
        answers = np.split(known.ask(np.concatenate(request)), np.cumsum([len(a) for a in request])[:-1])
        for k, (island, start, points_each) in enumerate(active):
            island.tell(answers[k])
            low = request[k][int(np.argmin(answers[k]))]
            finite = answers[k][np.isfinite(answers[k])]
            if island.settled or (finite.size > 1 and np.ptp(finite) <= SETTLED):
                ended += [start, np.clip(low, 0.0, 1.0)]
                again = _distant_minimum(known, ended, distance)
                active[k] = Island(again, SIZE, 2 * points_each, int(next(seeds))), again, 2 * points_each
    return known.over or "settled"


def _distant_minimum(known: EvaluatedPoints, ended: list[np.ndarray], distance: float) -> np.ndarray:
    """Return the lowest point that is distant from all settled islands; without one, the lowest of all points."""
    points, values = known.all
    far = np.ones(len(values), bool)
    for point in ended:
        far &= np.max(np.abs(points - point), axis=1) >= distance
    chosen = np.where(far, values, np.inf) if np.isfinite(values[far]).any() else values
    return np.asarray(points[int(np.argmin(chosen))])
