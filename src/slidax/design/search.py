"""The best of some laws on common cases: horizon and estimator first, then the surface, then the final radius."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slidax.studies.cases import Values

from .choice import DRIFTS, FINER, FINEST, SLOPES, About, Choice
from .trials import Trials, Worst

FEW, MANY = 8, 48
"""Cases in the search, and for the final radius."""

CALM = 0.9
"""Of what is wished of the torque step, or of what the drives can change in a period, where they are at their limit."""

AGAIN = 3
"""How often the ladder begins anew: a narrower envelope has a steeper surface, and a smaller error."""

LADDER = ((1.5, 2.2, 3.3), (5.0, 8.0, 14.0), (25.0, 50.0, 100.0))
"""Final radii that are tried, times the largest steady error: wider ones where the first do not hold."""

SPARE = 1.3
"""The final radius over the smallest one that held in the common cases: others are farther off."""

LEAST_MARGIN = 0.01
"""Of an envelope's width, that must be left in every common case."""


def searched(trials: Trials, *, kalman: bool, step: float | None, error: float | None) -> tuple[Worst, list[Worst]]:
    """The best of all, and all of them: envelopes as wide as `slidax new` draws them.

    - `trials`: on what.
    - `kalman`: whether the estimator has a density.
    - `step`: largest change of torque that is allowed [N m]; None for any.
    - `error`: the steady error that is small enough [rad]; None for as small as it gets.
    """
    cases, first = trials.cases(FEW), trials.first
    calm, step = step is not None, min(trials.frame.change, np.inf if step is None else step)
    drifts = DRIFTS if kalman else (None,)
    found = trials.judged(
        [replace(first, horizon=H, drift=one) for H in trials.frame.horizons for one in drifts], cases
    )
    best = chosen(found, step, error, calm=calm)
    steeper = [replace(best.choice, slope=one) for one in SLOPES if one != best.choice.slope]
    found = [*found, *trials.judged(steeper, cases)]
    for about in (FINER, FINEST)[: 1 + calm] if kalman else ():
        found += trials.judged(_finer(trials, chosen(found, step, error, calm=calm).choice, about), cases)
    return chosen(found, step, error, calm=calm), found


def _finer(trials: Trials, best: Choice, about: About) -> list[Choice]:
    """Choices about the best one, which is not among them."""
    assert best.drift is not None
    least = min(trials.frame.horizons)
    found = {
        (max(share * best.horizon, least), factor * best.drift, min(max(best.even + more, 0.0), 1.0))
        for share in about.horizons
        for factor in about.drifts
        for more in about.evens
    } - {(best.horizon, best.drift, best.even)}
    return [replace(best, horizon=horizon, drift=drift, even=even) for horizon, drift, even in sorted(found)]


def chosen(found: Sequence[Worst], step: float, error: float | None, *, calm: bool = False) -> Worst:
    """Of those in which no case left: calm, exact enough, then the calmest; else the most exact, or by `cost`.

    - `found`: some.
    - `step`, `error`: as in `searched`.
    - `calm`: whether the step was wished, so that below it nothing is gained by less.
    """
    held = [one for one in found if one.holds]
    if not held:
        return max(found, key=lambda one: (-one.outside, one.margin))
    below = [one for one in held if one.step <= CALM * step] or [min(held, key=lambda one: one.step)]
    enough = [one for one in below if error is not None and one.error <= error]
    if enough:
        return min(enough, key=lambda one: (one.step, one.error))
    return min(below, key=cost if error is None and not calm else lambda one: one.error)


def cost(one: Worst) -> float:
    """Error times torque step: half the error is worth twice the step.

    - `one`: with both.
    """
    return one.error * max(one.step, 1e-12)


def narrowest(trials: Trials, best: Worst, most: float) -> Worst | None:
    """The smallest final radius that no common case leaves, with some room; None if none up to the largest.

    - `trials`: on what.
    - `best`: the law.
    - `most`: the largest radius that is tried.
    """
    held, cases = None, trials.cases(MANY)
    for _ in range(AGAIN):
        found = _climbed(trials, best, most, cases)
        if found is None or (held is not None and found.choice.final[0] > 0.8 * held.choice.final[0]):
            return held or found
        held = best = found
    return held


def _climbed(trials: Trials, best: Worst, most: float, cases: Values) -> Worst | None:
    """The smallest radius of the ladder above the error of a law."""
    base = max(best.error / float(np.min(trials.frame.shape)), 1e-9)
    for step in LADDER:
        radii = sorted({min(base * factor, most) for factor in step})
        tried = trials.judged([replace(best.choice, final=radius * trials.frame.shape) for radius in radii], cases)
        held = [one.holds and one.margin >= LEAST_MARGIN for one in tried]
        if held[-1]:
            # The narrowest from which on all wider ones hold.
            return tried[len(held) - next((k for k, one in enumerate(reversed(held)) if not one), len(held))]
        if radii[-1] >= most:
            return None
    return None
