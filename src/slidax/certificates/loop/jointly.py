"""Error bounds of a set of arms with many joints, part by part of the set."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..arm.members import Members
from ..arm.part import Part, halves, part_of
from ..demand import Demand
from .at_rest import at_rest
from .coupled import Coupled
from .entered import Entry
from .propagation import Bounds
from .setting import Certified, Since
from .subject import Subject

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
class Jointly:
    """The bound of a set in parts.

    - `worst`: the part with the largest bounds, or without any; `parts`: all parts.
    - `bounds`: the largest of all parts; None where a part has none.
    """

    worst: Coupled
    parts: list[Part]
    bounds: Certified | None


def jointly(
    subject: Subject,
    entry: Entry,
    demand: Demand,
    since: Since,
    chance: float,
    known_parts: list[Part] | None = None,
    fineness: Fineness = FINE,
) -> Jointly:
    """Return the bounds of a set, with all joints as one loop.

    - `chance`: probability that normal noise exceeds its bound.
    - `known_parts`: the parts of the set, which are then not divided.
    - `fineness`: of parts and responses.
    """
    scenario, motion = subject.scenario, since.ideal.motion
    waiting: list[tuple[Members | Part, int]]
    waiting = [(piece, 0) for piece in known_parts] if known_parts else [(Members.of(scenario), fineness.halvings)]
    parts: list[Part] = []
    results: list[tuple[Coupled, Certified]] = []
    while waiting:
        piece, left = waiting.pop()
        part = part_of(scenario, piece, motion, entry.arms, demand.push) if isinstance(piece, Members) else piece
        divided = halves(part, scenario, motion) if left and not entry.arms and not known_parts else []
        if divided and left > fineness.halvings - AT_ONCE:
            waiting += [(half, left - 1) for half in divided]
            continue
        coupled = Coupled(subject, demand, since, part, chance, fineness.width)
        bounds = at_rest(coupled) if coupled.stable else None
        if divided and (bounds is None or np.max(bounds.share) >= 1.0):
            waiting += [(half, left - 1) for half in divided]
            continue
        parts.append(part)
        if bounds is None:
            return Jointly(coupled, parts, None)
        results.append((coupled, bounds))
    worst = max(results, key=lambda pair: float(np.max(pair[1].share)))[0]
    return Jointly(worst, parts, _largest([bounds for _, bounds in results]))


def _largest(bounds_of_parts: list[Certified]) -> Certified:
    """The largest of some bounds."""
    first = bounds_of_parts[0]
    bounds = Bounds(
        *(np.max([getattr(part.bounds, each.name) for part in bounds_of_parts], axis=0) for each in fields(Bounds))
    )
    error, share, noise = (
        np.max([getattr(part, name) for part in bounds_of_parts], axis=0) for name in ("error", "share", "noise")
    )
    return Certified(first.subject, first.narrowing, bounds, error, share, first.kappa, first.spread, noise)
