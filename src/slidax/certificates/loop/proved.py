"""The bounds of a scenario's set, from when it keeps its plans on, with what its arms ask beside the planned run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..arm.demand import demand as demand_of
from ..demand import Demand
from ..verdict import Assumption
from .assembled import Assembly
from .entered import Entry, approached
from .ideal import Ideal, ideal_of
from .premises import of_the_entry, of_the_loops
from .remedies import scaled
from .setting import Certified, Since
from .subject import Subject

Floats = NDArray[np.floating[Any]]

SPARE = 2.0
"""So many times what cases show of where the arms are when the bound begins."""

BEGINNINGS = (0.0, 0.3, 0.6, 1.0)
"""Where a bound may begin, from when all cases keep s, to when the envelope is narrow: the first that holds."""

NARROW = 1.05
"""An envelope has reached its final width where it is at most so many times as wide as at the end."""

ROUNDS = 16
"""In which what is asked for beside the planned run must have come to rest."""

ABOVE = 1.05
"""By which each round takes more than it found, so that the next may confirm it."""

AGAIN = 2.0
"""A torque is computed for one prediction, and what it does is predicted from another: each misses as much."""

FAR = 1e3
"""Shares of an envelope's side from which on a bound is none."""


@dataclass(frozen=True, eq=False)
class Proved:
    """What is certain of a set.

    - `entry`: from when, and where its arms then are.
    - `ideal`: the run that is planned from there, `demand` what the set asks for along it.
    - `assembly`, `found`: the bounds; None where a loop does not settle, or no bound was found.
    - `premises`: what the bounds stand on, beside what is asked of the loops.
    """

    entry: Entry
    ideal: Ideal
    demand: Demand
    assembly: Assembly
    found: Certified | None
    premises: list[Assumption]

    @property
    def holds(self) -> bool:
        """Whether no sample can be outside, and no premise fails."""
        if self.found is None or any(one.status == "fails" for one in self.premises):
            return False
        return bool(np.max(self.found.share) < 1.0)


def proved(subject: Subject, chance: float = 1e-3) -> Proved | str:
    """The bounds of a scenario's set; a reason if its cases do not come to where they could begin.

    - `subject`: the law on its task.
    - `chance`: that normal noise is larger than is counted at some sample.

    Raises DefinitionError for a set that is invalid.
    """
    approach = approached(subject)
    if isinstance(approach, str):
        return approach
    narrow = max(_narrow(subject, approach.samples), approach.late)
    for share in BEGINNINGS:
        entry = approach.entry(approach.late + round(share * (narrow - approach.late)))
        ideal = ideal_of(subject, entry)
        demand = demand_of(subject.scenario, along=ideal.motion, seen=entry.seen)
        whole = _bounded(subject, entry, ideal, demand, chance)
        if not whole.assembly.stable or whole.holds:
            break
    return whole


def _narrow(subject: Subject, samples: int) -> int:
    """The first sample at which the envelope is as narrow as at the end, or nearly; the middle of the run at most."""
    t = jnp.asarray(np.arange(samples) * subject.scenario.period)
    drawn, joints = subject.drawn.performance, subject.law.joints
    radius = np.asarray(jax.vmap(lambda one: jnp.broadcast_to(drawn.radius(one), (joints,)))(t))
    narrow = np.all(radius <= NARROW * radius[-1], axis=1)
    return min(int(np.argmax(narrow)), samples // 2)


def of_a_part(whole: Proved, part: float, chance: float = 1e-3) -> Proved:
    """The same for a set that is so many times as large, around the arm that the law believes in.

    - `whole`: of the whole set.
    - `part`: of each of its numbers.
    - `chance`: as in `proved`.
    """
    return _bounded(whole.assembly.subject, whole.entry, whole.ideal, scaled(whole.demand, part), chance, part)


def _bounded(subject: Subject, entry: Entry, ideal: Ideal, demand: Demand, chance: float, part: float = 1.0) -> Proved:
    assembly = Assembly(subject, demand, chance, Since(ideal, part * SPARE * entry.states, part * SPARE * entry.slid))
    found = _at_rest(assembly) if assembly.stable else None
    premises = of_the_entry(entry, assembly, SPARE)
    if found is not None:
        premises += of_the_loops(assembly, found, chance)
    return Proved(entry, ideal, demand, assembly, found, premises)


def _at_rest(assembly: Assembly) -> Certified | None:
    """Bounds that ask for no more beside the planned run than they were given; None if none was found.

    Each round takes what the last one's bounds ask for. Where it finds no more than that, induction over the samples
    shows that the bounds are true: what is asked for in a period depends on what came before.
    """
    demand = assembly.demand
    assert demand.beside is not None
    assert demand.misread is not None
    late = assembly.subject.law.delay > 0.0
    more = misread = np.zeros(demand.push.shape[1:])
    for _ in range(ROUNDS):
        found = assembly.certified(more, misread)
        if not np.max(found.share) < FAR:
            return None
        radius, speed, missed, lapse = assembly.reach(found)
        read = demand.misread(missed, lapse)
        asked = demand.beside(radius, speed) + read
        if (asked <= more).all() and (AGAIN * late * read <= misread).all():
            return found
        more, misread = np.maximum(more, ABOVE * asked), np.maximum(misread, ABOVE * AGAIN * late * read)
        if not np.isfinite(more).all():
            return None
    return None
