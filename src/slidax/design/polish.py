"""A law moved about: horizon, estimator, surface and envelope at once, on common cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.studies.cases import Values
from slidax.studies.search.island import Island, population

from .choice import LARGEST, Choice, Frame
from .trials import Trials, Worst

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


def polished(
    trials: Trials,
    start: Choice,
    cases: Values,
    cost: Callable[[Worst], float],
    *,
    free: bool,
    size: float,
    seed: int,
) -> list[Worst]:
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
    result: list[Worst] = []
    for _ in range(GENERATIONS):
        request = np.clip(island.ask(), 0.0, 1.0)
        tried = trials.judged([_moved(trials.frame, start, names, free, point) for point in request], cases)
        island.tell(np.array([cost(item) for item in tried]))
        result += tried
    return result


def _moved(frame: Frame, start: Choice, names: list[str], free: bool, point: NDArray[np.floating[Any]]) -> Choice:
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
