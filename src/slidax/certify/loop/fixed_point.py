"""Fixed-point iteration: repeat until the deviation bound is self-consistent, for the whole set or part by part."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..arm.demand import Demand
from ..arm.hull import SetPart, set_part, split_part
from ..arm.members import Members
from .bound_recursion import BoundStart, CertifiedBounds, ErrorBounds
from .coupled_bound import CoupledProblem
from .decoupled_bound import DecoupledProblem
from .initial_set import InitialSet
from .problem import LoopProblem

ROUNDS = 16
"""Largest number of rounds; twice as many for the coupled loop."""

ABOVE = 1.05
"""Factor by which each round enlarges its result, so that the next may confirm it."""

AGAIN = 2.0
"""A torque is computed for one prediction, and its effect predicted from another: each error counts."""

FAR = 1e3
"""Shares of an envelope's side from which on a bound is useless."""


def fixed_point(assembly: DecoupledProblem | CoupledProblem, enough: float = FAR) -> CertifiedBounds | None:
    """Return bounds whose deviation demand is no larger than the demand they assume; None if none was found.

    Each round takes the demand of the last round's bounds. Where it is no larger, induction over the samples proves the
    bounds: the demand in a period depends on earlier samples only.

    - `enough`: share of an envelope's side at which to stop; each round finds more than the last.
    """
    demand = assembly.demand
    assert demand.deviation is not None
    assert demand.prediction_error is not None
    late = assembly.subject.law.delay > 0.0
    more = misread = np.zeros(demand.disturbance.shape[1:])
    for _ in range(ROUNDS if isinstance(assembly, DecoupledProblem) else 2 * ROUNDS):
        bounds = assembly.certified(more, misread)
        if not np.max(bounds.share) < min(enough, FAR):
            return None
        radius, speed, missed, lapse = assembly.reach(bounds)
        read = demand.prediction_error(missed, lapse)
        request = demand.deviation(radius, speed) + read
        confirmed = isinstance(assembly, DecoupledProblem) or assembly.confirmed
        if confirmed and (request <= more).all() and (AGAIN * late * read <= misread).all():
            return bounds
        more, misread = np.maximum(more, ABOVE * request), np.maximum(misread, ABOVE * AGAIN * late * read)
        if not np.isfinite(more).all():
            return None
    return None


AT_ONCE = 2
"""Divisions of the set before a bound is tried: smaller parts have less uncertainty of K."""

JOINTS = 4
"""Number of joints from which on the loops are bounded as one; fewer are bounded more sharply one by one."""


@dataclass(frozen=True)
class Fineness:
    """Resolution of the bounds for many joints: finer ones are smaller and take longer.

    - `halvings`: largest number of divisions of a part of the set for which a bound does not hold.
    - `width`: decisions that share one response.
    """

    halvings: int = 3
    width: int = 16


FINE = Fineness()


@dataclass(frozen=True, eq=False)
class PartitionedBound:
    """The bound of a set in parts.

    - `worst`: the part with the largest bounds, or without any; `parts`: all parts.
    - `bounds`: the largest of all parts; None where a part has none.
    """

    worst: CoupledProblem
    parts: list[SetPart]
    bounds: CertifiedBounds | None


def partitioned_bound(
    subject: LoopProblem,
    entry: InitialSet,
    demand: Demand,
    since: BoundStart,
    chance: float,
    known_parts: list[SetPart] | None = None,
    fineness: Fineness = FINE,
) -> PartitionedBound:
    """Return the bounds of a set, with all joints as one loop.

    - `chance`: probability that normal noise exceeds its bound.
    - `known_parts`: the parts of the set, which are then not divided.
    - `fineness`: of parts and responses.
    """
    scenario, motion = subject.scenario, since.ideal.motion
    waiting: list[tuple[Members | SetPart, int]]
    waiting = [(piece, 0) for piece in known_parts] if known_parts else [(Members.of(scenario), fineness.halvings)]
    parts: list[SetPart] = []
    results: list[tuple[CoupledProblem, CertifiedBounds]] = []
    while waiting:
        piece, left = waiting.pop()
        part = (
            set_part(scenario, piece, motion, entry.arms, demand.disturbance) if isinstance(piece, Members) else piece
        )
        divided = split_part(part, scenario, motion) if left and not entry.arms and not known_parts else []
        if divided and left > fineness.halvings - AT_ONCE:
            waiting += [(half, left - 1) for half in divided]
            continue
        coupled = CoupledProblem(subject, demand, since, part, chance, fineness.width)
        bounds = fixed_point(coupled) if coupled.stable else None
        if divided and (bounds is None or np.max(bounds.share) >= 1.0):
            waiting += [(half, left - 1) for half in divided]
            continue
        parts.append(part)
        if bounds is None:
            return PartitionedBound(coupled, parts, None)
        results.append((coupled, bounds))
    worst = max(results, key=lambda pair: float(np.max(pair[1].share)))[0]
    return PartitionedBound(worst, parts, _largest([bounds for _, bounds in results]))


def _largest(bounds_of_parts: list[CertifiedBounds]) -> CertifiedBounds:
    """The largest of some bounds."""
    first = bounds_of_parts[0]
    bounds = ErrorBounds(
        *(np.max([getattr(part.bounds, each.name) for part in bounds_of_parts], axis=0) for each in fields(ErrorBounds))
    )
    error, share, noise = (
        np.max([getattr(part, name) for part in bounds_of_parts], axis=0) for name in ("error", "share", "noise")
    )
    return CertifiedBounds(first.subject, first.narrowing, bounds, error, share, first.kappa, first.spread, noise)
