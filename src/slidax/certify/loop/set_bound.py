"""Error bounds of a scenario's uncertainty set, and the assumptions behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.errors import count_noun

from ..arm.demand import Demand, compute_demand
from ..arm.hull import SPARE as SLOPE
from ..arm.hull import STRIDE, SetPart
from ..arm.learned_demand import learns_inertia
from ..certificate import Assumption, Status
from .bound_recursion import BoundProblem, BoundStart, CertifiedBounds
from .coupled_bound import SPARE as OFF
from .coupled_bound import CoupledProblem
from .coupled_responses import EVERY
from .decoupled_bound import DecoupledProblem
from .envelope import STEPS
from .fixed_point import FINE, JOINTS, Fineness, fixed_point, partitioned_bound
from .initial_set import InitialSet, NominalMember, NominalRun, planned_run, simulate_cases
from .problem import LoopProblem
from .remedies import scale_demand


def initial_set_assumptions(entry: InitialSet, assembly: BoundProblem, spare: float) -> list[Assumption]:
    """Return the assumptions about the initial set.

    - `spare`: factor by which the spread in the simulated cases is enlarged.
    """
    since = float(assembly.set_in[0])
    unit = assembly.subject.law.nominal.joint_units
    far = float(np.max(np.abs(entry.states[:, 0])))
    cases = count_noun(entry.cases, "case")
    return [
        Assumption(
            f"until t = {since:.3g} s no member leaves the envelope, as in {cases} of the set, whose least margin is "
            f"{entry.margin:.2g} of its width",
            "tested",
            entry.margin,
        ),
        Assumption(
            f"then no member deviates from the nominal one by more than {spare:g} times the spread of these cases, at "
            f"most {far:.2g} {'rad' if 'rad' in unit else unit[0]}",
            "tested",
            far,
        ),
        Assumption(
            f"from then on torque and torque rate stay within their limits, as in the {cases} above",
            "tested",
            float(entry.cases),
        ),
    ]


def covered_members(assembly: BoundProblem) -> str:
    """Return the arms that a bound covers, for a sentence."""
    scenario = assembly.subject.scenario
    if assembly.since is None:
        return "every arm of the given demand"
    if not scenario.description.uncertainty:
        return "the scenario's own arm"
    if learns_inertia(scenario):
        return f"{assembly.since.states.shape[0]} simulated arms of the set, and all of its disturbances"
    return "every arm and disturbance of the set"


def loop_assumptions(assembly: DecoupledProblem, certified: CertifiedBounds, chance: float) -> list[Assumption]:
    """Return the assumptions of the decoupled bound, without those of its demand."""
    spread = float(np.max(certified.spread))
    cells = certified.kappa.shape[1]
    return [
        Assumption(
            "κ may change in any way within its range"
            if cells == 1
            else f"κ of a joint stays within a factor {(1.0 + spread) ** 2:.3g} during its loop's memory, in any of "
            f"{cells} parts of its range",
            _at_most(assembly) if cells == 1 else "assumed",
            (1.0 + spread) ** 2,
        ),
        *law_assumptions(assembly, certified, chance),
    ]


def coupling_assumption(parts: Sequence[SetPart]) -> Assumption:
    """Return the assumption about K for all arms of a set."""
    arms = max(part.arms for part in parts)
    where = f", in each of {len(parts)} parts of the set" if len(parts) > 1 else ""
    text = (
        f"K of every arm is enclosed at each {STRIDE}th sample{where}"
        if arms == 0
        else f"K of every arm lies between those of {arms} {'member' if arms == 1 else 'members'} that were evaluated"
        f"{where}"
    )
    text += (
        f"; between these samples it is within {OFF:.1%} of a line, its slopes are at most {SLOPE:g} times those of "
        f"three members by central differences, and the decay of all loops was checked from each {EVERY}th sample"
    )
    return Assumption(text, "tested", float(len(parts)))


def nominal_member_assumption() -> Assumption:
    """Return the assumption about the nominal member's run."""
    text = "prediction errors in the nominal member's run affect all members alike: to first order they cancel"
    return Assumption(text, "assumed")


def law_assumptions(assembly: BoundProblem, certified: CertifiedBounds, chance: float) -> list[Assumption]:
    """Return the assumptions that the law keeps s and compensates its estimate, and others of the bound."""
    listed = [_covered(assembly, certified), _followed(assembly, certified), _computed(assembly)]
    listed.append(Assumption("the measurement gate rejects no sample of the arm itself", "assumed"))
    if assembly.ideal is None:
        listed += [
            Assumption("torque and torque rate stay within their limits (see `torque_budget`)", "assumed"),
            Assumption("M0 and the bias change little within a period and the delay", "assumed"),
        ]
    if assembly.noise.random:
        text = f"the sensors' normal noise stays within its bound, except with probability {chance:g}"
        listed.append(Assumption(text, "assumed", chance))
    slim = np.any(certified.narrowing.slim)
    if slim or np.any(certified.narrowing.unruly):
        where = "N or A are at a tenth of ρ" if slim else "N is not convex or ρ̇ not concave"
        text = f"{where} during some of the approach, so the closed form does not hold; the recursion needs neither"
        listed.append(Assumption(text, _at_most(assembly)))
    return listed


def _at_most(assembly: BoundProblem) -> Status:
    """Best status of a bound for each arm: a law that learns is only tested, on simulated arms."""
    return "tested" if learns_inertia(assembly.subject.scenario) else "proved"


def _computed(assembly: BoundProblem) -> Assumption:
    """The quantities of the bound that were evaluated at finitely many points."""
    text = f"the slope of the surface function follows a table of {2 ** (STEPS + 1)} places and their ratios"
    if assembly.ideal is not None:
        text += "; the error of a torque for a predicted state follows from first derivatives"
    return Assumption(text, "tested")


def _covered(assembly: BoundProblem, certified: CertifiedBounds) -> Assumption:
    """The assumption that u keeps s at zero."""
    u, layer = assembly.sliding.cover, assembly.subject.cover()[1]
    if np.isinf(u).all():
        return Assumption("the sliding variable is reached, s⁺ = 0", "assumed")
    needed = (2.0 if layer > 0 else 1.0) * certified.bounds.needed
    share = "twice " if layer > 0 else ""
    over = np.flatnonzero(needed > u)
    worst = int(np.argmax(needed / u))
    if not over.size:
        text = f"u covers {share}the bound of s: {needed[worst]:.3g} N m of {u[worst]:.3g} N m in the tightest case"
        return Assumption(text, "tested", float(needed[worst]))
    if assembly.ideal is not None or over[-1] >= 0.75 * needed.size:
        text = (
            f"u covers {share}the bound of s: this needs {needed[worst]:.3g} N m, and u is {u[worst]:.3g} N m, at "
            f"t = {certified.narrowing.times[worst]:.3g} s"
        )
        return Assumption(text, "fails", float(needed[worst]))
    since = float(certified.narrowing.times[over[-1] + 1])
    text = (
        f"s is reached and kept before t = {since:.3g} s, while u = {np.min(u):.3g} N m is not shown to cover the "
        "estimation error; from then on it is"
    )
    return Assumption(text, "assumed", since)


def _followed(assembly: BoundProblem, certified: CertifiedBounds) -> Assumption:
    """The assumption that the whole estimate is compensated."""
    u, h = assembly.sliding.cover, assembly.period
    missed = np.linalg.norm(np.einsum("kij,kj->ki", assembly.sliding.mass, certified.bounds.estimate / h**2), axis=1)
    size = assembly.lumped + missed
    late = float(np.max(size[(3 * size.size) // 4 :]))
    if np.isinf(u).all():
        return Assumption("the whole estimated disturbance is compensated", "assumed", late)
    over = np.flatnonzero(size > u)
    if not over.size:
        worst = int(np.argmax(size / u))
        text = (
            f"the whole estimated disturbance, at most {size[worst]:.3g} N m of u's {u[worst]:.3g} N m, is compensated"
        )
        return Assumption(text, "tested", float(size[worst]))
    status: Status = "fails" if assembly.ideal is not None or over[-1] >= 0.75 * size.size else "assumed"
    worst = int(np.argmax(size / u))
    text = (
        f"the whole estimated disturbance is compensated: it may reach {size[worst]:.3g} N m, and u covers "
        f"{u[worst]:.3g} N m"
    )
    return Assumption(text, status, float(size[worst]))


SPARE = 2.0
"""Factor by which the spread in the simulated cases is enlarged when the bound begins."""

BEGINNINGS = (0.0, 0.3, 0.6, 1.0)
"""Shares at which a bound may begin, from all cases keeping s to a narrow envelope: the first that holds counts."""

NARROW = 1.05
"""Factor of the final width below which an envelope counts as narrow."""


@dataclass(frozen=True, eq=False)
class SetBound:
    """The bound of a set.

    - `entry`: the initial set.
    - `ideal`: the nominal run from there, `demand` the demand of the set along it.
    - `assembly`, `bounds`: the problem and its bounds; None if a loop is not stable, or no bound was found.
    - `premises`: assumptions, without those of the demand.
    - `parts`: of the set, if all joints are one loop.
    """

    entry: InitialSet
    ideal: NominalRun
    demand: Demand
    assembly: DecoupledProblem | CoupledProblem
    bounds: CertifiedBounds | None
    premises: list[Assumption]
    parts: Sequence[SetPart] = ()

    @property
    def holds(self) -> bool:
        """True if no sample can be outside, and no assumption fails."""
        if self.bounds is None or any(line.status == "fails" for line in self.premises):
            return False
        return bool(np.max(self.bounds.share) < 1.0)


def set_bound(
    subject: LoopProblem, chance: float = 1e-3, beginnings: Sequence[float] = BEGINNINGS, fineness: Fineness = FINE
) -> SetBound | str:
    """Return the bounds of a scenario's set; or the reason if its cases do not reach a state where they could begin.

    - `chance`: probability that normal noise exceeds its bound at some sample.
    - `beginnings`: shares at which a bound may begin, for up to three joints; the first that holds counts.
    - `fineness`: of the bounds from four joints on.

    Raises DefinitionError for an invalid set.
    """
    approach = simulate_cases(subject)
    if isinstance(approach, str):
        return approach
    narrow = max(_narrow(subject, approach.samples), approach.late)
    middle = NominalMember.of(subject) if subject.law.joints >= JOINTS else None
    if middle is None and subject.law.joints >= JOINTS:
        return "the nominal member of the set leaves its envelope"

    def since(share: float, enough: float = np.inf) -> SetBound:
        sample = approach.late + round(share * (narrow - approach.late))
        entry = approach.entry(sample, None if middle is None else middle.trace)
        ideal = planned_run(subject, entry) if middle is None else middle.ideal(entry)
        demand = compute_demand(subject.scenario, along=ideal.motion, cases=entry.arms)
        return _bounded(subject, entry, ideal, demand, chance, enough=enough, fineness=fineness)

    *earlier, latest = beginnings if subject.law.joints < JOINTS else BEGINNINGS[-1:]
    for share in earlier:
        # If none holds only the latest bound is reported, so the others need not be complete.
        whole = since(share, 1.0)
        if not whole.assembly.stable or whole.holds:
            return whole
    return since(latest)


def _narrow(subject: LoopProblem, samples: int) -> int:
    """The first sample with nearly the final envelope; the middle of the run at most."""
    t = jnp.asarray(np.arange(samples) * subject.scenario.period)
    drawn, joints = subject.drawn.performance, subject.law.joints
    radius = np.asarray(jax.vmap(lambda time: jnp.broadcast_to(drawn.radius(time), (joints,)))(t))
    narrow = np.all(radius <= NARROW * radius[-1], axis=1)
    return min(int(np.argmax(narrow)), samples // 2)


def bound_of_smaller_set(whole: SetBound, part: float, chance: float = 1e-3) -> SetBound:
    """Return the bounds of a set scaled around its middle, or around the law's model.

    - `part`: factor of each of its values.
    """
    subject, shared = whole.assembly.subject, whole.ideal.disturbance
    parts = [] if shared is None else [own.shrunk(part, shared) for own in whole.parts]
    # The demand of deviations from the nominal run does not depend on the size of the set.
    demand = whole.demand if parts else scale_demand(whole.demand, part)
    return _bounded(subject, whole.entry, whole.ideal, demand, chance, part, parts)


def _bounded(
    subject: LoopProblem,
    entry: InitialSet,
    ideal: NominalRun,
    demand: Demand,
    chance: float,
    part: float = 1.0,
    parts: list[SetPart] | None = None,
    enough: float = np.inf,
    fineness: Fineness = FINE,
) -> SetBound:
    since = BoundStart(ideal, part * SPARE * entry.states, part * SPARE * entry.slid)
    if subject.law.joints >= JOINTS:
        whole = partitioned_bound(subject, entry, demand, since, chance, parts, fineness)
        premises = initial_set_assumptions(entry, whole.worst, SPARE)
        if whole.bounds is not None:
            premises += [
                coupling_assumption(whole.parts),
                nominal_member_assumption(),
                *law_assumptions(whole.worst, whole.bounds, chance),
            ]
        return SetBound(entry, ideal, demand, whole.worst, whole.bounds, premises, whole.parts)
    assembly = DecoupledProblem(subject, demand, chance, since)
    certified = fixed_point(assembly, enough) if assembly.stable else None
    premises = initial_set_assumptions(entry, assembly, SPARE)
    if certified is not None:
        premises += loop_assumptions(assembly, certified, chance)
    return SetBound(entry, ideal, demand, assembly, certified, premises)
