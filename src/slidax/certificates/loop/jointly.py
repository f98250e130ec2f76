"""The bounds of a set of arms with many joints, part by part of the set."""

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
"""So often the set is divided before a bound is looked for: what is not known of K then feeds itself less."""

JOINTS = 4
"""From so many on the joints' loops are bounded as one: fewer are bounded more sharply each by itself."""


@dataclass(frozen=True)
class Fineness:
    """How finely a set of arms with many joints is looked at: the finer, the smaller its bounds, and the later.

    - `halvings`: so often a part of the set for which a bound does not hold is divided in two.
    - `width`: decisions around one whose responses are taken for all of them.
    """

    halvings: int = 3
    width: int = 16


FINE = Fineness()


@dataclass(frozen=True, eq=False)
class Jointly:
    """What was found of a set.

    - `worst`: of its parts, that with the largest bounds, or which has none; `parts`: how many there are.
    - `found`: the bounds, the largest of all parts; None where a part has none.
    """

    worst: Coupled
    parts: list[Part]
    found: Certified | None


def jointly(
    subject: Subject,
    entry: Entry,
    demand: Demand,
    since: Since,
    chance: float,
    given: list[Part] | None = None,
    fineness: Fineness = FINE,
) -> Jointly:
    """The bounds of a set whose joints' loops are taken as one.

    - `subject`, `entry`, `demand`, `since`: the law, how its arms came to their plans, and what they ask for.
    - `chance`: that normal noise is larger than is counted.
    - `given`: the parts of the set, which are then not divided.
    - `fineness`: of its parts and responses.
    """
    scenario, motion = subject.scenario, since.ideal.motion
    waiting: list[tuple[Members | Part, int]]
    waiting = [(one, 0) for one in given] if given else [(Members.of(scenario), fineness.halvings)]
    parts: list[Part] = []
    found: list[tuple[Coupled, Certified]] = []
    while waiting:
        one, left = waiting.pop()
        part = part_of(scenario, one, motion, entry.seen, demand.push) if isinstance(one, Members) else one
        divided = halves(part, scenario, motion) if left and not entry.seen and not given else []
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
        found.append((coupled, bounds))
    worst = max(found, key=lambda pair: float(np.max(pair[1].share)))[0]
    return Jointly(worst, parts, _largest([bounds for _, bounds in found]))


def _largest(found: list[Certified]) -> Certified:
    """The largest of some bounds."""
    first = found[0]
    bounds = Bounds(*(np.max([getattr(one.bounds, each.name) for one in found], axis=0) for each in fields(Bounds)))
    error, share, noise = (
        np.max([getattr(one, name) for one in found], axis=0) for name in ("error", "share", "noise")
    )
    return Certified(first.subject, first.narrowing, bounds, error, share, first.kappa, first.spread, noise)
