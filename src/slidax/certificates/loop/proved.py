"""The bounds of a scenario's set, from when it keeps its plans on, with what its arms ask beside the planned run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..arm.demand import demand as demand_of
from ..arm.part import Part
from ..demand import Demand
from ..verdict import Assumption
from .assembled import Assembly
from .at_rest import at_rest
from .coupled import Coupled
from .entered import Entry, approached
from .ideal import Ideal, ideal_of
from .jointly import FINE, JOINTS, Fineness, jointly
from .middle import Middle
from .premises import of_the_entry, of_the_law, of_the_loops, of_the_middle, of_the_parts
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


@dataclass(frozen=True, eq=False)
class Proved:
    """What is certain of a set.

    - `entry`: from when, and where its arms then are.
    - `ideal`: the run that is planned from there, `demand` what the set asks for along it.
    - `assembly`, `found`: the bounds; None where a loop does not settle, or no bound was found.
    - `premises`: what the bounds stand on, beside what is asked of the loops.
    - `parts`: of the set, where the joints' loops are taken as one.
    """

    entry: Entry
    ideal: Ideal
    demand: Demand
    assembly: Assembly | Coupled
    found: Certified | None
    premises: list[Assumption]
    parts: Sequence[Part] = ()

    @property
    def holds(self) -> bool:
        """Whether no sample can be outside, and no premise fails."""
        if self.found is None or any(one.status == "fails" for one in self.premises):
            return False
        return bool(np.max(self.found.share) < 1.0)


def proved(
    subject: Subject, chance: float = 1e-3, beginnings: Sequence[float] = BEGINNINGS, fineness: Fineness = FINE
) -> Proved | str:
    """The bounds of a scenario's set; a reason if its cases do not come to where they could begin.

    - `subject`: the law on its task.
    - `chance`: that normal noise is larger than is counted at some sample.
    - `beginnings`: where a bound may begin, of up to three joints, the first of them that holds.
    - `fineness`: of the bounds from four joints on.

    Raises DefinitionError for a set that is invalid.
    """
    approach = approached(subject)
    if isinstance(approach, str):
        return approach
    narrow = max(_narrow(subject, approach.samples), approach.late)
    middle = Middle.of(subject) if subject.law.joints >= JOINTS else None
    if middle is None and subject.law.joints >= JOINTS:
        return "the arm in the middle of the set leaves its envelope"

    def since(share: float, enough: float = np.inf) -> Proved:
        sample = approach.late + round(share * (narrow - approach.late))
        entry = approach.entry(sample, None if middle is None else middle.seen)
        ideal = ideal_of(subject, entry) if middle is None else middle.ideal(entry)
        demand = demand_of(subject.scenario, along=ideal.motion, seen=entry.seen)
        return _bounded(subject, entry, ideal, demand, chance, enough=enough, fineness=fineness)

    *earlier, latest = beginnings if subject.law.joints < JOINTS else BEGINNINGS[-1:]
    for share in earlier:
        # Only the latest bound is told where none holds, so that others need not be known in full.
        whole = since(share, 1.0)
        if not whole.assembly.stable or whole.holds:
            return whole
    return since(latest)


def _narrow(subject: Subject, samples: int) -> int:
    """The first sample at which the envelope is as narrow as at the end, or nearly; the middle of the run at most."""
    t = jnp.asarray(np.arange(samples) * subject.scenario.period)
    drawn, joints = subject.drawn.performance, subject.law.joints
    radius = np.asarray(jax.vmap(lambda one: jnp.broadcast_to(drawn.radius(one), (joints,)))(t))
    narrow = np.all(radius <= NARROW * radius[-1], axis=1)
    return min(int(np.argmax(narrow)), samples // 2)


def of_a_part(whole: Proved, part: float, chance: float = 1e-3) -> Proved:
    """The same for a set that is so many times as large, around its middle, or the arm that the law believes in.

    - `whole`: of the whole set.
    - `part`: of each of its numbers.
    - `chance`: as in `proved`.
    """
    subject, shared = whole.assembly.subject, whole.ideal.push
    parts = [] if shared is None else [one.shrunk(part, shared) for one in whole.parts]
    # Beside the middle one's run an arm asks for as much, however large the set.
    demand = whole.demand if parts else scaled(whole.demand, part)
    return _bounded(subject, whole.entry, whole.ideal, demand, chance, part, parts)


def _bounded(
    subject: Subject,
    entry: Entry,
    ideal: Ideal,
    demand: Demand,
    chance: float,
    part: float = 1.0,
    parts: list[Part] | None = None,
    enough: float = np.inf,
    fineness: Fineness = FINE,
) -> Proved:
    since = Since(ideal, part * SPARE * entry.states, part * SPARE * entry.slid)
    if subject.law.joints >= JOINTS:
        whole = jointly(subject, entry, demand, since, chance, parts, fineness)
        premises = of_the_entry(entry, whole.worst, SPARE)
        if whole.found is not None:
            premises += [of_the_parts(whole.parts), of_the_middle(), *of_the_law(whole.worst, whole.found, chance)]
        return Proved(entry, ideal, demand, whole.worst, whole.found, premises, whole.parts)
    assembly = Assembly(subject, demand, chance, since)
    found = at_rest(assembly, enough) if assembly.stable else None
    premises = of_the_entry(entry, assembly, SPARE)
    if found is not None:
        premises += of_the_loops(assembly, found, chance)
    return Proved(entry, ideal, demand, assembly, found, premises)
