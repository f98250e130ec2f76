"""The search for a design: horizon and estimator first, then all values by CMA-ES, then the final radius."""

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
"""Of CMA-ES."""

TIMES = {"horizon": 2.5, "slope": 8.0, "bend": 6.0, "overshoot": 4.0, "drift": 6.0, "gain": 4.0, "margin": 4.0}
"""Largest factor of each value, and its reciprocal."""

FINAL = 10.0
"""The same of the final radius."""

OVERSHOOTS = (0.1, 0.95)
"""θ that are tried."""

EVENS = (-0.5, 1.5)
"""From more to less than in proportion to the torques."""


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
    """Laws about a good one, by CMA-ES with each generation at once; all that were tried.

    - `trials`: on what.
    - `start`: where it begins.
    - `cases`: the common ones.
    - `cost`: what is to be small.
    - `free`: whether the final radius may be another.
    - `size`: first standard deviation, of the cube.
    - `seed`: of the random numbers.
    """
    left_out = {"gain" if start.drift is not None else "drift"}
    if trials.frame.least_margin is None:
        left_out.add("margin")
    names = [name for name in TIMES if name not in left_out]
    dimension = len(names) + free + (start.drift is not None)
    island = Island(np.full(dimension, 0.5), size, population(dimension), seed)
    result: list[WorstCase] = []
    for _ in range(GENERATIONS):
        request = np.clip(island.ask(), 0.0, 1.0)
        tried = trials.judged([_moved(trials.frame, start, names, free, point) for point in request], cases)
        island.tell(np.array([cost(item) for item in tried]))
        result += tried
    return result


def _moved(
    frame: DesignSpace, start: DesignPoint, names: list[str], free: bool, point: NDArray[np.floating[Any]]
) -> DesignPoint:
    """The law at a point of the cube, in the middle of which is the first one."""
    turns = iter((2.0 * point - 1.0).tolist())
    changes: dict[str, Any] = {name: getattr(start, name) * TIMES[name] ** next(turns) for name in names}
    changes["horizon"] = max(changes["horizon"], frame.least)
    changes["overshoot"] = float(np.clip(changes["overshoot"], *OVERSHOOTS))
    if frame.least_margin is not None:
        changes["margin"] = max(changes["margin"], frame.least_margin)
    if start.drift is not None:
        changes["even"] = float(np.clip(start.even + next(turns), *EVENS))
    if free:
        changes["final"] = np.minimum(start.final * FINAL ** next(turns), LARGEST * frame.initial)
    return replace(start, **changes)


FEW, MANY, MOST = 8, 48, 96
"""Cases in the search, for the final radius, and to choose of what was found: a largest step is known by many alone."""

POLISH = 6
"""Cases of the second search."""

SIZES, REQUIRED = (0.15, 0.08), (0.15, 0.1, 0.06)
"""First standard deviation of each turn of CMA-ES in the unit cube; a required torque step takes one turn more."""

TOP = 5
"""Of the laws of each turn, that are tried in the many cases."""

HARD = 3
"""Of the many cases, that are among the few of the next turn where laws came too near in them."""

AGAIN = 3
"""Number of restarts of the ladder: a narrower envelope has a steeper surface, and a smaller error."""

LADDER = ((1.5, 2.2, 3.3), (5.0, 8.0, 14.0), (25.0, 50.0, 100.0))
"""Final radii that are tried, times the largest steady error: wider ones where the first do not hold."""

NEAR = (1.8, 2.6, 4.0, 6.0, 9.0, 14.0)
"""The same for where the second search begins."""

SPARE = 1.3
"""The final radius over the smallest one that held in the common cases: others are farther off."""

LEAST_MARGIN = 0.01
"""Of an envelope's width, that must be left in every common case."""


def coarse_search(trials: Trials, aim: Objective, *, kalman: bool) -> WorstCase:
    """The best horizon, density and surface, with envelopes as wide as `slidax new` draws them.

    - `trials`: on what.
    - `aim`: what is better.
    - `kalman`: whether the estimator has a density.
    """
    cases, first = trials.beyond(FEW), trials.first
    drifts = DRIFTS if kalman else (None,)
    result = trials.judged(
        [replace(first, horizon=H, drift=item) for H in trials.frame.horizons for item in drifts], cases
    )
    best = aim.best(result)
    steeper = [replace(best.choice, slope=item) for item in SLOPES if item != best.choice.slope]
    return aim.best([*result, *trials.judged(steeper, cases)])


def fine_search(trials: Trials, best: WorstCase, aim: Objective) -> WorstCase:
    """The best law about one, judged in many cases.

    In few cases the largest torque step is smaller than in many, by a share that a turn finds for the next, and some of
    the many are harder: the next turn has these.

    - `trials`: on what.
    - `best`: where the search begins.
    - `aim`: what is better.
    """
    cases, many = trials.beyond(POLISH), trials.beyond(MOST)
    free = trials.problem.requirements.accuracy == "best"
    start = _near(trials, best, aim) if free else replace(best, choice=replace(best.choice, final=trials.frame.shape))
    result, share = trials.judged([start.choice, best.choice], many), 1.0
    for turn, size in enumerate(REQUIRED if aim.required else SIZES):
        tried = cmaes_search(trials, start.choice, cases, aim.stricter(share).cost, free=free, size=size, seed=turn)
        top = sorted(tried, key=aim.stricter(share).cost)[:TOP]
        judged = trials.judged([item.choice for item in top], many)
        result += judged
        start = aim.best(result)
        # A run that ends at once has no torque step.
        shares = [few.step / more.step for few, more in zip(top, judged, strict=True) if more.step > 0.0]
        share = float(np.median(shares or [1.0]))
        hard = [item.case for item in sorted(judged, key=lambda item: item.margin) if item.margin < aim.room]
        if hard and many:
            rows = list(dict.fromkeys(hard))[:HARD]
            trials = trials.with_harder({path: array[rows] for path, array in trials.cases(MOST).items()})
            cases = trials.beyond(POLISH)
    (last,) = trials.judged([start.choice], trials.cases(MOST))
    if last.holds:
        return last
    # A smaller uncertainty does not always give a smaller error.
    others = sorted(result, key=aim.cost)[: 2 * TOP]
    return aim.best([last, *trials.judged([item.choice for item in others], trials.cases(MOST))])


def _near(trials: Trials, best: WorstCase, aim: Objective) -> WorstCase:
    """The same with the narrowest final radius that few cases hold, so that the search begins near its end."""
    if not best.holds:
        return best
    shape, most = trials.frame.shape, trials.most
    base = max(best.error / float(np.min(shape)), 1e-9)
    tried = trials.judged(
        [replace(best.choice, final=min(base * factor, most) * shape) for factor in NEAR], trials.beyond(FEW)
    )
    return next((item for item in tried if item.holds and item.margin >= LEAST_MARGIN), best)


def narrowest_envelope(trials: Trials, best: WorstCase, step: float = np.inf) -> WorstCase | None:
    """The smallest final radius that no common case leaves, with some room; None if none up to the largest.

    - `trials`: on what.
    - `best`: the law.
    - `step`: largest change of torque that is allowed [N m].
    """
    held, cases = None, trials.beyond(MANY)
    for _ in range(AGAIN):
        result = _climbed(trials, best, step, cases)
        if result is None or (held is not None and result.choice.final[0] > 0.8 * held.choice.final[0]):
            return held or result
        held = best = result
    return held


def _climbed(trials: Trials, best: WorstCase, most_step: float, cases: Values) -> WorstCase | None:
    """The smallest radius of the ladder above the error of a law."""
    most, shape = trials.most, trials.frame.shape
    base = max(best.error / float(np.min(shape)), 1e-9)
    for step in LADDER:
        radii = sorted({min(base * factor, most) for factor in step})
        tried = trials.judged([replace(best.choice, final=radius * shape) for radius in radii], cases)
        held = [item.holds and item.margin >= LEAST_MARGIN and item.step <= most_step for item in tried]
        if held[-1]:
            # The narrowest from which on all wider ones hold.
            return tried[len(held) - next((k for k, item in enumerate(reversed(held)) if not item), len(held))]
        if radii[-1] >= most:
            return None
    return None
