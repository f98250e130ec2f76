"""Fixed-point iteration: repeat until the deviation bound is self-consistent."""

from __future__ import annotations

import numpy as np

from .assembled import Assembly
from .coupled import Coupled
from .setting import Certified

ROUNDS = 16
"""Largest number of rounds; twice as many for the coupled loop."""

ABOVE = 1.05
"""Factor by which each round enlarges its result, so that the next may confirm it."""

AGAIN = 2.0
"""A torque is computed for one prediction, and its effect predicted from another: each error counts."""

FAR = 1e3
"""Shares of an envelope's side from which on a bound is useless."""


def at_rest(assembly: Assembly | Coupled, enough: float = FAR) -> Certified | None:
    """Return bounds whose deviation demand is no larger than the demand they assume; None if none was found.

    Each round takes the demand of the last round's bounds. Where it is no larger, induction over the samples proves the
    bounds: the demand in a period depends on earlier samples only.

    - `enough`: share of an envelope's side at which to stop; each round finds more than the last.
    """
    demand = assembly.demand
    assert demand.deviation is not None
    assert demand.prediction_error is not None
    late = assembly.subject.law.delay > 0.0
    more = misread = np.zeros(demand.push.shape[1:])
    for _ in range(ROUNDS if isinstance(assembly, Assembly) else 2 * ROUNDS):
        bounds = assembly.certified(more, misread)
        if not np.max(bounds.share) < min(enough, FAR):
            return None
        radius, speed, missed, lapse = assembly.reach(bounds)
        read = demand.prediction_error(missed, lapse)
        request = demand.deviation(radius, speed) + read
        confirmed = isinstance(assembly, Assembly) or assembly.confirmed
        if confirmed and (request <= more).all() and (AGAIN * late * read <= misread).all():
            return bounds
        more, misread = np.maximum(more, ABOVE * request), np.maximum(misread, ABOVE * AGAIN * late * read)
        if not np.isfinite(more).all():
            return None
    return None
