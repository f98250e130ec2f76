"""The search for a design: horizon and estimator first, then all values by CMA-ES, then the final radius.

All candidate laws are simulated in the same cases of the uncertainty set, the common cases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.studies.cases import Values
from slidax.studies.search import Island, population

from .candidates import DRIFTS, LARGEST, SLOPES, DesignPoint, DesignSpace
from .trials import Objective, Trials, WorstCase

GENERATIONS = 10
"""Number of generations of CMA-ES."""

TIMES = {"horizon": 2.5, "slope": 8.0, "bend": 6.0, "overshoot": 4.0, "drift": 6.0, "gain": 4.0, "margin": 4.0}
"""Each value is searched between its start divided by this factor and its start times this factor."""

FINAL = 10.0
"""The final radius is searched between its start divided by this factor and its start times this factor."""

OVERSHOOTS = (0.1, 0.95)
"""Range of ϑ in the search."""

EVENS = (-0.5, 1.5)
"""Range of `DesignPoint.even` in the search."""


def cmaes_search(
    trials: Trials,
    start: DesignPoint,
    cases: Values,
    cost: Callable[[WorstCase], float],
    *,
    free: bool,
    size: float,
    seed: int,
) -> list[WorstCase]:
    """Search around a law by CMA-ES, and return all laws of the search with their worst cases.

    - `trials`: simulates the laws.
    - `start`: the law in the middle of the search.
    - `cases`: the common cases, from `Trials.cases` or `Trials.widened_cases`.
    - `cost`: cost of a law, from its worst case.
    - `free`: True to search the final radius, too.
    - `size`: initial standard deviation of CMA-ES, as a share of each value's search range.
    - `seed`: seed of the random numbers.
    """
    left_out = {"gain" if start.drift is not None else "drift"}
    if trials.space.least_margin is None:
        left_out.add("margin")
    names = [name for name in TIMES if name not in left_out]
    dimension = len(names) + free + (start.drift is not None)
    island = Island(np.full(dimension, 0.5), size, population(dimension), seed)
    result: list[WorstCase] = []
    for _ in range(GENERATIONS):
        request = np.clip(island.ask(), 0.0, 1.0)
        tried = trials.evaluate([_point_at(trials.space, start, names, free, point) for point in request], cases)
        island.tell(np.array([cost(item) for item in tried]))
        result += tried
    return result


def _point_at(
    space: DesignSpace, start: DesignPoint, names: list[str], free: bool, point: NDArray[np.floating[Any]]
) -> DesignPoint:
    """Return the law at a point of the unit cube, whose middle is the law `start`."""
    turns = iter((2.0 * point - 1.0).tolist())
    changes: dict[str, Any] = {name: getattr(start, name) * TIMES[name] ** next(turns) for name in names}
    changes["horizon"] = max(changes["horizon"], space.least)
    changes["overshoot"] = float(np.clip(changes["overshoot"], *OVERSHOOTS))
    if space.least_margin is not None:
        changes["margin"] = max(changes["margin"], space.least_margin)
    if start.drift is not None:
        changes["even"] = float(np.clip(start.even + next(turns), *EVENS))
    if free:
        changes["final"] = np.minimum(start.final * FINAL ** next(turns), LARGEST * space.initial)
    return replace(start, **changes)


FEW, MANY, MOST = 8, 48, 96
"""Numbers of cases: in the search, for the final radius, and for the choice among results. Few cases underestimate the
largest torque step."""

POLISH = 6
"""Number of cases in `fine_search`."""

SIZES, REQUIRED = (0.15, 0.08), (0.15, 0.1, 0.06)
"""Initial standard deviation in the unit cube for each turn, a run of CMA-ES; a required torque step takes a third."""

TOP = 5
"""Number of laws of each turn that are simulated in many cases."""

HARD = 3
"""Largest number of hard cases, those with too small a margin, that the next turn adds to its few cases."""

AGAIN = 3
"""Largest number of passes over the radii: a narrower envelope has a steeper surface, and so a smaller error."""

LADDER = ((1.5, 2.2, 3.3), (5.0, 8.0, 14.0), (25.0, 50.0, 100.0))
"""Final radii to try, relative to the largest steady error; each next group only if the previous one fails."""

NEAR = (1.8, 2.6, 4.0, 6.0, 9.0, 14.0)
"""Final radii to try for the start of `fine_search`, relative to the largest steady error."""

SPARE = 1.3
"""Final radius, as a multiple of the smallest one that holds in the common cases: other cases have larger errors."""

LEAST_MARGIN = 0.01
"""Least margin in every common case, as a share of the envelope's width."""


def coarse_search(trials: Trials, aim: Objective, *, kalman: bool) -> WorstCase:
    """Return the best law of a grid of horizons and estimator densities, with its worst case.

    Then three slopes of the sliding surface are tried for the best law. The envelope is that of `trials.first`.

    - `trials`: simulates the laws.
    - `aim`: the objective, whose cost ranks the laws.
    - `kalman`: True for a Kalman filter, whose density is searched; False for the `measured` estimator.
    """
    cases, first = trials.widened_cases(FEW), trials.first
    drifts = DRIFTS if kalman else (None,)
    result = trials.evaluate(
        [replace(first, horizon=H, drift=item) for H in trials.space.horizons for item in drifts], cases
    )
    best = aim.best(result)
    steeper = [replace(best.choice, slope=item) for item in SLOPES if item != best.choice.slope]
    return aim.best([*result, *trials.evaluate(steeper, cases)])


def fine_search(trials: Trials, best: WorstCase, aim: Objective) -> WorstCase:
    """Search around a law by CMA-ES, and return the law with the best worst case over 96 cases.

    Each turn searches in few cases, and simulates its best laws in many cases. The hardest cases are added to the few
    cases of the next turn. The allowed torque step of the next turn is reduced by the ratio of the largest torque
    steps in few and in many cases.

    - `trials`: simulates the laws.
    - `best`: the law at which the search begins.
    - `aim`: the objective, whose cost ranks the laws.
    """
    cases, many = trials.widened_cases(POLISH), trials.widened_cases(MOST)
    free = trials.problem.requirements.accuracy == "best"
    start = (
        _near_narrowest(trials, best) if free else replace(best, choice=replace(best.choice, final=trials.space.shape))
    )
    result, share = trials.evaluate([start.choice, best.choice], many), 1.0
    for turn, size in enumerate(REQUIRED if aim.required else SIZES):
        tried = cmaes_search(trials, start.choice, cases, aim.stricter(share).cost, free=free, size=size, seed=turn)
        top = sorted(tried, key=aim.stricter(share).cost)[:TOP]
        judged = trials.evaluate([item.choice for item in top], many)
        result += judged
        start = aim.best(result)
        # A run that ends at its first sample has no torque step.
        shares = [few.step / more.step for few, more in zip(top, judged, strict=True) if more.step > 0.0]
        share = float(np.median(shares or [1.0]))
        hard = [item.case for item in sorted(judged, key=lambda item: item.margin) if item.margin < aim.room]
        if hard and many:
            rows = list(dict.fromkeys(hard))[:HARD]
            trials = trials.with_harder({path: array[rows] for path, array in trials.cases(MOST).items()})
            cases = trials.widened_cases(POLISH)
    (last,) = trials.evaluate([start.choice], trials.cases(MOST))
    if last.holds:
        return last
    # A smaller uncertainty does not always give a smaller error.
    others = sorted(result, key=aim.cost)[: 2 * TOP]
    return aim.best([last, *trials.evaluate([item.choice for item in others], trials.cases(MOST))])


def _near_narrowest(trials: Trials, best: WorstCase) -> WorstCase:
    """Return the law with the smallest final radius of `NEAR` that holds in few cases, as a start for the search."""
    if not best.holds:
        return best
    shape, most = trials.space.shape, trials.most
    base = max(best.error / float(np.min(shape)), 1e-9)
    tried = trials.evaluate(
        [replace(best.choice, final=min(base * factor, most) * shape) for factor in NEAR], trials.widened_cases(FEW)
    )
    return next((item for item in tried if item.holds and item.margin >= LEAST_MARGIN), best)


def narrowest_envelope(trials: Trials, best: WorstCase, step: float = np.inf) -> WorstCase | None:
    """Return the law with the smallest final radius of `LADDER` that holds in 48 cases; None if none holds.

    A law holds if each error keeps a margin of 1 % of the envelope's width, and no torque step exceeds `step`.

    - `trials`: simulates the laws.
    - `best`: the law whose other values the result has.
    - `step`: largest allowed torque step [N m].
    """
    held, cases = None, trials.widened_cases(MANY)
    for _ in range(AGAIN):
        result = _climb(trials, best, step, cases)
        if result is None or (held is not None and result.choice.final[0] > 0.8 * held.choice.final[0]):
            return held or result
        held = best = result
    return held


def _climb(trials: Trials, best: WorstCase, most_step: float, cases: Values) -> WorstCase | None:
    """Return the law with the smallest radius of `LADDER` that holds; None if none does."""
    most, shape = trials.most, trials.space.shape
    base = max(best.error / float(np.min(shape)), 1e-9)
    for step in LADDER:
        radii = sorted({min(base * factor, most) for factor in step})
        tried = trials.evaluate([replace(best.choice, final=radius * shape) for radius in radii], cases)
        held = [item.holds and item.margin >= LEAST_MARGIN and item.step <= most_step for item in tried]
        if held[-1]:
            # The narrowest radius for which it and all wider ones hold.
            return tried[len(held) - next((k for k, item in enumerate(reversed(held)) if not item), len(held))]
        if radii[-1] >= most:
            return None
    return None
