"""Assumptions of `loop_rate`, in addition to those of the demand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax._errors import counted

from ..arm.learnt import learns
from ..arm.part import SPARE as SLOPE
from ..arm.part import STRIDE, Part
from ..verdict import Assumption, Status
from .assembled import Assembly
from .coupled import SPARE as OFF
from .coupled_kernels import EVERY
from .entered import Entry
from .setting import Certified, Setting
from .slopes import STEPS


def of_the_entry(entry: Entry, assembly: Setting, spare: float) -> list[Assumption]:
    """Return the assumptions about the initial set.

    - `spare`: factor by which the spread in the simulated cases is enlarged.
    """
    since = float(assembly.set_in[0])
    unit = assembly.subject.law.nominal.joint_units
    far = float(np.max(np.abs(entry.states[:, 0])))
    cases = counted(entry.cases, "case")
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


def of_whom(assembly: Setting) -> str:
    """Return the arms that a bound covers, for a sentence."""
    scenario = assembly.subject.scenario
    if assembly.since is None:
        return "every arm of the given demand"
    if not scenario.description.uncertainty:
        return "the scenario's own arm"
    if learns(scenario):
        return f"{assembly.since.states.shape[0]} simulated arms of the set, and all of its disturbances"
    return "every arm and disturbance of the set"


def of_the_loops(assembly: Assembly, certified: Certified, chance: float) -> list[Assumption]:
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
        *of_the_law(assembly, certified, chance),
    ]


def of_the_parts(parts: Sequence[Part]) -> Assumption:
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


def of_the_middle() -> Assumption:
    """Return the assumption about the nominal member's run."""
    text = "prediction errors in the nominal member's run affect all members alike: to first order they cancel"
    return Assumption(text, "assumed")


def of_the_law(assembly: Setting, certified: Certified, chance: float) -> list[Assumption]:
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


def _at_most(assembly: Setting) -> Status:
    """Best status of a bound for each arm: a law that learns is only tested, on simulated arms."""
    return "tested" if learns(assembly.subject.scenario) else "proved"


def _computed(assembly: Setting) -> Assumption:
    """The quantities of the bound that were evaluated at finitely many points."""
    text = f"the slope of the surface function follows a table of {2 ** (STEPS + 1)} places and their ratios"
    if assembly.ideal is not None:
        text += "; the error of a torque for a predicted state follows from first derivatives"
    return Assumption(text, "tested")


def _covered(assembly: Setting, certified: Certified) -> Assumption:
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


def _followed(assembly: Setting, certified: Certified) -> Assumption:
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
