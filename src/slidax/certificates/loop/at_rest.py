"""Bounds that ask for no more beside the planned run than they were given."""

from __future__ import annotations

import numpy as np

from .assembled import Assembly
from .coupled import Coupled
from .setting import Certified

ROUNDS = 16
"""In which what is asked for beside the planned run must have come to rest; twice as many for loops taken as one."""

ABOVE = 1.05
"""By which each round takes more than it found, so that the next may confirm it."""

AGAIN = 2.0
"""A torque is computed for one prediction, and what it does is predicted from another: each misses as much."""

FAR = 1e3
"""Shares of an envelope's side from which on a bound is none."""


def at_rest(assembly: Assembly | Coupled, enough: float = FAR) -> Certified | None:
    """Bounds that ask for no more beside the planned run than they were given; None if none was found.

    Each round takes what the last one's bounds ask for. Where it finds no more than that, induction over the samples
    shows that the bounds are true: what is asked for in a period depends on what came before.

    - `assembly`: of the bounds.
    - `enough`: shares of an envelope's side from which on they are not looked for; each round finds more than the last.
    """
    demand = assembly.demand
    assert demand.beside is not None
    assert demand.misread is not None
    late = assembly.subject.law.delay > 0.0
    more = misread = np.zeros(demand.push.shape[1:])
    for _ in range(ROUNDS if isinstance(assembly, Assembly) else 2 * ROUNDS):
        found = assembly.certified(more, misread)
        if not np.max(found.share) < min(enough, FAR):
            return None
        radius, speed, missed, lapse = assembly.reach(found)
        read = demand.misread(missed, lapse)
        asked = demand.beside(radius, speed) + read
        confirmed = isinstance(assembly, Assembly) or assembly.confirmed
        if confirmed and (asked <= more).all() and (AGAIN * late * read <= misread).all():
            return found
        more, misread = np.maximum(more, ABOVE * asked), np.maximum(misread, ABOVE * AGAIN * late * read)
        if not np.isfinite(more).all():
            return None
    return None
