"""Error bounds of a scenario's uncertainty set, from its initial set on, with the demand of deviating members."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from ..arm.demand import compute_demand
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

SPARE = 2.0
"""Factor by which the spread in the simulated cases is enlarged when the bound begins."""

BEGINNINGS = (0.0, 0.3, 0.6, 1.0)
"""Shares at which a bound may begin, from all cases keeping s to a narrow envelope: the first that holds counts."""

NARROW = 1.05
"""Factor of the final width below which an envelope counts as narrow."""


@dataclass(frozen=True, eq=False)
class Proved:
    """The bound of a set.

    - `entry`: the initial set.
    - `ideal`: the nominal run from there, `demand` the demand of the set along it.
    - `assembly`, `bounds`: the problem and its bounds; None if a loop is not stable, or no bound was found.
    - `premises`: assumptions, without those of the demand.
    - `parts`: of the set, if all joints are one loop.
    """

    entry: Entry
    ideal: Ideal
    demand: Demand
    assembly: Assembly | Coupled
    bounds: Certified | None
    premises: list[Assumption]
    parts: Sequence[Part] = ()

    @property
    def holds(self) -> bool:
        """True if no sample can be outside, and no assumption fails."""
        if self.bounds is None or any(line.status == "fails" for line in self.premises):
            return False
        return bool(np.max(self.bounds.share) < 1.0)


def proved(
    subject: Subject, chance: float = 1e-3, beginnings: Sequence[float] = BEGINNINGS, fineness: Fineness = FINE
) -> Proved | str:
    """Return the bounds of a scenario's set; or the reason if its cases do not reach a state where they could begin.

    - `chance`: probability that normal noise exceeds its bound at some sample.
    - `beginnings`: shares at which a bound may begin, for up to three joints; the first that holds counts.
    - `fineness`: of the bounds from four joints on.

    Raises DefinitionError for an invalid set.
    """
    approach = approached(subject)
    if isinstance(approach, str):
        return approach
    narrow = max(_narrow(subject, approach.samples), approach.late)
    middle = Middle.of(subject) if subject.law.joints >= JOINTS else None
    if middle is None and subject.law.joints >= JOINTS:
        return "the nominal member of the set leaves its envelope"

    def since(share: float, enough: float = np.inf) -> Proved:
        sample = approach.late + round(share * (narrow - approach.late))
        entry = approach.entry(sample, None if middle is None else middle.trace)
        ideal = ideal_of(subject, entry) if middle is None else middle.ideal(entry)
        demand = compute_demand(subject.scenario, along=ideal.motion, cases=entry.arms)
        return _bounded(subject, entry, ideal, demand, chance, enough=enough, fineness=fineness)

    *earlier, latest = beginnings if subject.law.joints < JOINTS else BEGINNINGS[-1:]
    for share in earlier:
        # If none holds only the latest bound is reported, so the others need not be complete.
        whole = since(share, 1.0)
        if not whole.assembly.stable or whole.holds:
            return whole
    return since(latest)


def _narrow(subject: Subject, samples: int) -> int:
    """The first sample with nearly the final envelope; the middle of the run at most."""
    t = jnp.asarray(np.arange(samples) * subject.scenario.period)
    drawn, joints = subject.drawn.performance, subject.law.joints
    radius = np.asarray(jax.vmap(lambda time: jnp.broadcast_to(drawn.radius(time), (joints,)))(t))
    narrow = np.all(radius <= NARROW * radius[-1], axis=1)
    return min(int(np.argmax(narrow)), samples // 2)


def of_a_part(whole: Proved, part: float, chance: float = 1e-3) -> Proved:
    """Return the bounds of a set scaled around its middle, or around the law's model.

    - `part`: factor of each of its values.
    """
    subject, shared = whole.assembly.subject, whole.ideal.push
    parts = [] if shared is None else [own.shrunk(part, shared) for own in whole.parts]
    # The demand of deviations from the nominal run does not depend on the size of the set.
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
        if whole.bounds is not None:
            premises += [of_the_parts(whole.parts), of_the_middle(), *of_the_law(whole.worst, whole.bounds, chance)]
        return Proved(entry, ideal, demand, whole.worst, whole.bounds, premises, whole.parts)
    assembly = Assembly(subject, demand, chance, since)
    certified = at_rest(assembly, enough) if assembly.stable else None
    premises = of_the_entry(entry, assembly, SPARE)
    if certified is not None:
        premises += of_the_loops(assembly, certified, chance)
    return Proved(entry, ideal, demand, assembly, certified, premises)
