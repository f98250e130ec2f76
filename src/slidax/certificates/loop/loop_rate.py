"""The certificate `loop_rate`: no sample is outside, for all arms and disturbances of a set."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario

from ..demand import Demand
from ..verdict import Assumption, Verdict
from .assembled import Assembly, Certified
from .remedies import found_remedies
from .subject import Subject

Floats = NDArray[np.floating[Any]]

NAME, TITLE = "loop_rate", "no sample leaves its envelope at this rate"

NARROW = 1.05
"""An envelope has reached its final width where it is at most so many times as wide as at the end."""

TRIES = 8
"""Final radii that are tried for the smallest one."""


def loop_rate(scenario: Scenario, demand: Demand, *, chance: float = 1e-3, remedies: bool = True) -> Verdict:
    """Whether the error's certain bound stays within the envelope at all samples (docs/certificates/loop-rate.md).

    - `scenario`: with a law in sampled-data form that plans, and a linear estimator.
    - `demand`: what the set of arms asks of its loops.
    - `chance`: that normal noise is larger than is counted at some sample of the run.
    - `remedies`: whether the smallest changes that make it hold are looked for.
    """
    subject = Subject.of(scenario)
    if isinstance(subject, str):
        return _not_applicable(subject)
    assembly = Assembly(subject, demand, chance)
    if not assembly.stable:
        return _unstable(assembly)
    if not np.isfinite(demand.stray).all():
        return _unbounded(demand)
    found = assembly.certified()
    radius = required_radius(assembly, found)
    settled = settled_from(found)
    worst = np.max(found.share, axis=0)
    assumptions = [*demand.assumptions, *_assumptions(assembly, found, settled, chance)]
    fails = any(one.status == "fails" for one in assumptions)
    holds = bool(np.max(worst) < 1.0) and not fails
    joint = int(np.argmax(worst))
    names, units = subject.law.nominal.joint_names, subject.law.nominal.joint_units
    missed = np.max(found.bounds.missed[settled:], axis=0) / assembly.horizon**2
    error = np.max(found.bounds.error[settled:], axis=(0, 1))
    k = int(np.argmax(found.share[:, joint]))
    statement = (
        f"the error of `{names[joint]}` reaches at most {worst[joint]:.2g} of its envelope's side, at "
        f"t = {found.narrowing.times[k]:.3g} s; there the plan misses at most "
        f"{found.bounds.missed[k, joint] / assembly.horizon**2:.3g} {units[joint]}/s² "
        "(docs/certificates/loop-rate.md, (8))"
    )
    fixes: list[Remedy] = []
    if not holds and remedies:
        fixes = found_remedies(scenario, demand, radius, _kept)
    bound = {
        "w_bar": missed,
        "error_bound": error,
        "required_radius": radius,
        "share": worst,
        "noise": found.noise,
        "from": float(found.narrowing.times[settled]),
        "kappa": np.asarray(demand.kappa),
    }
    return Verdict(NAME, TITLE, holds, float(1.0 - np.max(worst)), bound, assumptions, statement, fixes)


def _unbounded(demand: Demand) -> Verdict:
    """Where the arm beside its reference may ask for anything, there is nothing to add up."""
    since = demand.times[int(np.argmin(np.isfinite(demand.stray).all(axis=1)))]
    text = (
        "what is asked of the loops beside the reference has a finite bound over the width of the envelope: it has "
        f"none at t = {since:.3g} s"
    )
    statement = (
        "No bound of the error was found: while the envelope is wide the arm may be so far beside its reference that "
        "what the model lacks there is not bounded (docs/certificates/loop-rate.md). Nothing is said of whether the "
        "envelope holds; `statistical` has runs"
    )
    kappa = {"kappa": np.asarray(demand.kappa)}
    return Verdict(NAME, TITLE, False, None, kappa, [*demand.assumptions, Assumption(text, "fails")], statement)


def _kept(scenario: Scenario, demand: Demand) -> float:
    """The largest share of an envelope's side that may be reached; infinite where no bound is found."""
    subject = Subject.of(scenario)
    if isinstance(subject, str):
        return float("inf")
    assembly = Assembly(subject, demand)
    return float(np.max(assembly.certified().share)) if assembly.stable else float("inf")


def settled_from(found: Certified) -> int:
    """The first sample at which all envelopes are as narrow as at the end, or nearly; the last quarter at the latest.

    - `found`: the bounds of a scenario.
    """
    narrow = np.all(found.narrowing.radius <= NARROW * found.narrowing.radius[-1], axis=1)
    first = int(np.argmax(narrow)) if narrow.any() else narrow.size - 1
    return min(first, (3 * narrow.size) // 4)


def required_radius(assembly: Assembly, found: Certified) -> Floats:
    """The smallest final radius of each joint that is certified, the others as narrow [n]; nan where none is found.

    The bound hardly depends on the final radius where the surface is steep, so that a few tries lead there.

    - `assembly`: of the scenario.
    - `found`: its bounds as it is.
    """
    settled = settled_from(found)
    sides = np.stack([-found.narrowing.lower, found.narrowing.upper])
    initial = np.asarray(found.subject.drawn.performance.initial)

    def asked(one: Certified) -> Floats:
        late: Floats = np.max(one.bounds.error[settled:] / sides[None], axis=(0, 1))
        return late

    radius = np.minimum(1.02 * asked(found), 0.9 * initial)
    best = np.where(np.max(found.share, axis=0) < 1.0, found.narrowing.radius[-1], np.nan)
    for _ in range(TRIES):
        tried = assembly.certified(radius)
        holds = np.max(tried.share, axis=0) < 1.0
        if np.all(holds):
            smallest: Floats = np.fmin(best, radius)
            return smallest
        radius = np.minimum(np.where(holds, radius, np.maximum(1.5 * radius, 1.05 * asked(tried))), 0.9 * initial)
    return np.asarray(best)


def _assumptions(assembly: Assembly, found: Certified, settled: int, chance: float) -> list[Assumption]:
    """What the bound stands on beside its demand."""
    spread = float(np.max(found.spread))
    cells = found.kappa.shape[1]
    listed = [
        Assumption(
            "κ may change in any way within its range"
            if cells == 1
            else f"κ of a joint stays within a factor {(1.0 + spread) ** 2:.3g} for as long as its loop remembers; "
            f"which part of its range that is, is not assumed ({cells} parts)",
            "proved" if cells == 1 else "assumed",
            (1.0 + spread) ** 2,
        ),
        _covered(found, settled),
        _followed(found, settled),
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
        listed.append(Assumption(text, "proved"))
    return listed


def _covered(found: Certified, settled: int) -> Assumption:
    u, layer = found.subject.cover()
    if np.isinf(u):
        return Assumption("the sliding variable is reached, s⁺ = 0", "assumed")
    needed = found.bounds.needed
    late = float(np.max(needed[settled:]))
    over = np.flatnonzero(needed > (0.5 if layer > 0 else 1.0) * u)
    since = found.narrowing.times[min(over[-1] + 1, needed.size - 1)] if over.size else 0.0
    share = "twice " if layer > 0 else ""
    if over.size and over[-1] >= settled:
        text = f"u covers {share}what is missed: it is at least {u:.3g} N m, and up to {late:.3g} N m are missed"
        return Assumption(text, "fails", late)
    if over.size:
        text = (
            f"s is reached and kept before t = {since:.3g} s, where u = {u:.3g} N m is not shown to cover what is "
            f"missed; from then on it is ({late:.3g} N m)"
        )
        return Assumption(text, "assumed", float(since))
    return Assumption(f"u covers {share}what is missed, {np.max(needed):.3g} of {u:.3g} N m", "checked", late)


def _followed(found: Certified, settled: int) -> Assumption:
    """That the estimate is compensated as a whole."""
    u, _ = found.subject.cover()
    h = found.narrowing.period
    size = np.linalg.norm(found.bounds.estimate, axis=1) / h**2 * found.subject.heavy(found.narrowing.times)
    late = float(np.max(size[settled:]))
    if np.isinf(u):
        return Assumption("the estimated push is compensated as a whole", "assumed", late)
    if late > u:
        text = f"the estimated push is compensated as a whole: it may be {late:.3g} N m, and u covers {u:.3g} N m"
        return Assumption(text, "fails" if late > u else "checked", late)
    status: Any = "checked" if float(np.max(size)) <= u else "assumed"
    text = f"the estimated push, at most {late:.3g} N m once the envelope is narrow, is compensated as a whole"
    return Assumption(text, status, float(np.max(size)))


def _not_applicable(why: str) -> Verdict:
    return Verdict(NAME, TITLE, None, None, {}, [], f"not applicable: {why}")


def _unstable(assembly: Assembly) -> Verdict:
    radius = np.array(
        [
            max(loop.radius(float(kappa)) for kappa in row)
            for loop, row in zip(assembly.subject.loops, assembly.kappa, strict=True)
        ]
    )
    joint = int(np.argmax(radius))
    low, high = assembly.demand.kappa[:, joint]
    name = assembly.subject.law.nominal.joint_names[joint]
    text = "each loop forgets what it knew within 4096 periods, for all κ of the set"
    statement = (
        f"the loop of `{name}` does not settle for all κ from {low:.2g} to {high:.2g} (modulus {radius[joint]:.4f} a "
        "period; see `inertia_ratio`)"
    )
    listed = [*assembly.demand.assumptions, Assumption(text, "fails", float(radius[joint]))]
    return Verdict(NAME, TITLE, False, None, {"radius": radius}, listed, statement)
