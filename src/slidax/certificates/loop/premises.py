"""What the bounds of `loop_rate` stand on, beside what is asked of the loops."""

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
    """How the arms of a set came to where their bounds begin.

    - `entry`: how.
    - `assembly`: the bounds.
    - `spare`: so many times what is seen is counted.
    """
    since = float(assembly.set_in[0])
    unit = assembly.subject.law.nominal.joint_units
    far = float(np.max(np.abs(entry.states[:, 0])))
    cases = counted(entry.cases, "case")
    return [
        Assumption(
            f"until t = {since:.3g} s the envelope is kept, as in {cases} of the set, where the least margin is "
            f"{entry.margin:.2g} of its width",
            "tested",
            entry.margin,
        ),
        Assumption(
            f"then no arm is farther from the middle one's than {spare:g} times what these cases show, {far:.2g} "
            f"{'rad' if 'rad' in unit else unit[0]} and less",
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
    """The arms that a bound is about, for a sentence.

    - `assembly`: the bound.
    """
    scenario = assembly.subject.scenario
    if assembly.since is None:
        return "every arm of the given demand"
    if not scenario.description.uncertainty:
        return "the scenario's own arm"
    if learns(scenario):
        return f"{assembly.since.states.shape[0]} simulated arms of the set, and all of its disturbances"
    return "every arm and disturbance of the set"


def of_the_loops(assembly: Assembly, found: Certified, chance: float) -> list[Assumption]:
    """What the bound stands on beside its demand.

    - `assembly`, `found`: the bound.
    - `chance`: that normal noise is larger than is counted.
    """
    spread = float(np.max(found.spread))
    cells = found.kappa.shape[1]
    return [
        Assumption(
            "κ may change in any way within its range"
            if cells == 1
            else f"κ of a joint stays within a factor {(1.0 + spread) ** 2:.3g} for as long as its loop remembers; "
            f"which part of its range that is, is not assumed ({cells} parts)",
            _at_most(assembly) if cells == 1 else "assumed",
            (1.0 + spread) ** 2,
        ),
        *of_the_law(assembly, found, chance),
    ]


def of_the_parts(parts: Sequence[Part]) -> Assumption:
    """How K is known for all arms of a set.

    - `parts`: of the set.
    """
    arms = max(part.arms for part in parts)
    where = f", in each of {len(parts)} parts of the set" if len(parts) > 1 else ""
    text = (
        f"K of every arm is enclosed at each {STRIDE}th sample{where}"
        if arms == 0
        else f"K of every arm lies between those of {arms} {'member' if arms == 1 else 'members'} that were looked at"
        f"{where}"
    )
    text += (
        f"; between these samples it is within {OFF:.1%} of a line, its slopes are at most {SLOPE:g} times those of "
        f"three members by central differences, and that all loops forget was looked at from each {EVERY}th sample"
    )
    return Assumption(text, "tested", float(len(parts)))


def of_the_middle() -> Assumption:
    """Of the run beside which all members are followed."""
    text = (
        "what the prediction misses in the middle one's own run does the same to all members: to first order it cancels"
    )
    return Assumption(text, "assumed")


def of_the_law(assembly: Setting, found: Certified, chance: float) -> list[Assumption]:
    """That the law reaches s and follows what it estimates, and what else the bound takes for granted.

    - `assembly`, `found`: the bound.
    - `chance`: that normal noise is larger than is counted.
    """
    listed = [_covered(assembly, found), _followed(assembly, found), _computed(assembly)]
    if assembly.ideal is None:
        listed += [
            Assumption("torque and torque rate stay within their limits (see `torque_budget`)", "assumed"),
            Assumption("M0 and the bias change little within a period and the delay", "assumed"),
        ]
    if assembly.noise.random:
        text = f"the normal noise of the sensors is no larger than is counted, but for a chance of {chance:g}"
        listed.append(Assumption(text, "assumed", chance))
    slim = np.any(found.narrowing.slim)
    if slim or np.any(found.narrowing.unruly):
        where = "N or A are at a tenth of ρ" if slim else "N is not convex or ρ̇ not concave"
        text = f"{where} for some of the approach, so that the closed form does not hold; the recursion needs neither"
        listed.append(Assumption(text, _at_most(assembly)))
    return listed


def _at_most(assembly: Setting) -> Status:
    """The status of what is proved for each arm of the bound: for a law that learns, these are simulated ones."""
    return "tested" if learns(assembly.subject.scenario) else "proved"


def _computed(assembly: Setting) -> Assumption:
    """The numbers inside the bound that were taken at finitely many places."""
    text = f"the pull of the surface is no steeper than at {2 ** (STEPS + 1)} places of a table and their ratios say"
    if assembly.ideal is not None:
        text += "; a torque that is computed for a predicted state is off by the first derivatives' share"
    return Assumption(text, "tested")


def _covered(assembly: Setting, found: Certified) -> Assumption:
    """That u keeps s at zero."""
    u, layer = assembly.sliding.cover, assembly.subject.cover()[1]
    if np.isinf(u).all():
        return Assumption("the sliding variable is reached, s⁺ = 0", "assumed")
    needed = (2.0 if layer > 0 else 1.0) * found.bounds.needed
    share = "twice " if layer > 0 else ""
    over = np.flatnonzero(needed > u)
    worst = int(np.argmax(needed / u))
    if not over.size:
        text = f"u covers {share}what s may be: {needed[worst]:.3g} N m of {u[worst]:.3g} N m where it is nearest"
        return Assumption(text, "tested", float(needed[worst]))
    if assembly.ideal is not None or over[-1] >= 0.75 * needed.size:
        text = (
            f"u covers {share}what s may be: {needed[worst]:.3g} N m, and it is {u[worst]:.3g} N m, at "
            f"t = {found.narrowing.times[worst]:.3g} s"
        )
        return Assumption(text, "fails", float(needed[worst]))
    since = float(found.narrowing.times[over[-1] + 1])
    text = (
        f"s is reached and kept before t = {since:.3g} s, where u = {np.min(u):.3g} N m is not shown to cover what is "
        f"missed; from then on it is"
    )
    return Assumption(text, "assumed", since)


def _followed(assembly: Setting, found: Certified) -> Assumption:
    """That the estimate is compensated as a whole."""
    u, h = assembly.sliding.cover, assembly.period
    missed = np.linalg.norm(np.einsum("kij,kj->ki", assembly.sliding.mass, found.bounds.estimate / h**2), axis=1)
    size = assembly.lumped + missed
    late = float(np.max(size[(3 * size.size) // 4 :]))
    if np.isinf(u).all():
        return Assumption("the estimated push is compensated as a whole", "assumed", late)
    over = np.flatnonzero(size > u)
    if not over.size:
        worst = int(np.argmax(size / u))
        text = f"the estimated push, at most {size[worst]:.3g} N m of u's {u[worst]:.3g} N m, is compensated as a whole"
        return Assumption(text, "tested", float(size[worst]))
    status: Status = "fails" if assembly.ideal is not None or over[-1] >= 0.75 * size.size else "assumed"
    worst = int(np.argmax(size / u))
    text = (
        f"the estimated push is compensated as a whole: it may be {size[worst]:.3g} N m, and u covers "
        f"{u[worst]:.3g} N m"
    )
    return Assumption(text, status, float(size[worst]))
