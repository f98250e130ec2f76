"""The certificate `loop_rate`: no sample is outside, for all arms and disturbances of a set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError
from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario

from ..certificate import ARM, certificate
from ..demand import Demand
from ..verdict import Assumption, Verdict
from .assembled import Assembly
from .coupled import Coupled
from .jointly import FINE, Fineness
from .premises import of_the_loops, of_whom
from .proved import BEGINNINGS, Proved, of_a_part, proved
from .remedies import altered, found_remedies, least, resampled, scaled, tried
from .setting import Certified, Setting
from .subject import Subject

Floats = NDArray[np.floating[Any]]

NAME, TITLE = "loop_rate", "no sample leaves its envelope at this rate"

NARROW = 1.05
"""An envelope has reached its final width where it is at most so many times as wide as at the end."""

TRIES = 3
"""Final radii that are tried for the smallest one, each half as wide again as the last."""

INSTANTS = 200
"""At which the bound is told over time."""

FEW = 3
"""Joints up to which other numbers of the law are tried as remedies, each with its own cases."""

PARTS = (0.5, 0.2)
"""Of what is uncertain, tried for more joints."""


@certificate(NAME, TITLE, covers=ARM)
def loop_rate(
    scenario: Scenario,
    demand: Demand | None = None,
    *,
    chance: float = 1e-3,
    remedies: bool = True,
    beginnings: Sequence[float] = BEGINNINGS,
    fineness: Fineness = FINE,
) -> Verdict:
    """Whether the error's certain bound stays within the envelope at all samples (docs/certificates/loop-rate.md).

    - `scenario`: with a law in sampled-data form that plans, and a linear estimator.
    - `demand`: what any set of arms asks of its loops along the reference, wherever the arm is; the scenario's own set,
      along the run that its law plans, if not given.
    - `chance`: that normal noise is larger than is counted at some sample of the run.
    - `remedies`: whether the smallest changes that make it hold, and the least final radius, are looked for.
    - `beginnings`: where the bound of a set may begin, from 0, when all its cases keep s, to 1, when the envelope is
      narrow: the first with which it holds.
    - `fineness`: of the bounds from four joints on.
    """
    subject = Subject.of(scenario)
    if isinstance(subject, str):
        return Verdict(NAME, TITLE, None, None, {}, [], f"not applicable: {subject}")
    if demand is not None:
        return _of_a_demand(subject, demand, chance, remedies)
    whole = proved(subject, chance, beginnings, fineness)
    if isinstance(whole, str):
        text = "a time from which on all cases of the set keep s and their limits, inside the envelope"
        statement = f"No bound of the error was found: {whole}. Nothing is said of whether the envelope holds"
        return Verdict(NAME, TITLE, False, None, {}, [Assumption(text, "fails")], statement)
    if not whole.assembly.stable:
        return _unstable(whole.assembly) if isinstance(whole.assembly, Assembly) else _unstable_together(whole)
    if whole.found is None:
        return _unbounded(whole, _for_a_set(scenario, whole, chance) if remedies else [])
    listed = [*whole.premises, *_of_the_demand(whole)]
    radius = _least_radius(scenario, whole, chance) if remedies else _asked_radius(whole.found)
    found = _judged(whole.assembly, whole.found, listed, radius)
    if found.holds or not remedies:
        return found
    return Verdict(
        NAME, TITLE, found.holds, found.margin, found.bound, found.assumptions, found.statement,
        _for_a_set(scenario, whole, chance, radius),
    )  # fmt: skip


def _of_a_demand(subject: Subject, demand: Demand, chance: float, remedies: bool) -> Verdict:
    assembly = Assembly(subject, demand, chance)
    if not assembly.stable:
        return _unstable(assembly)
    found = assembly.certified()
    radius = _asked_radius(found)
    verdict = _judged(
        assembly, found, [*demand.assumptions, *demand.of_kappa, *of_the_loops(assembly, found, chance)], radius
    )
    if verdict.holds or not remedies:
        return verdict

    def share(scenario: Scenario, part: float = 1.0) -> float:
        other = Subject.of(scenario)
        if isinstance(other, str):
            return float("inf")
        given = demand if abs(scenario.period - subject.scenario.period) < 1e-12 else resampled(demand, scenario.period)
        bound = Assembly(other, scaled(given, part), chance)
        return float(np.max(bound.certified().share)) if bound.stable else float("inf")

    fixes = found_remedies(subject.scenario, radius, share, lambda part: share(subject.scenario, part))
    return Verdict(NAME, TITLE, False, verdict.margin, verdict.bound, verdict.assumptions, verdict.statement, fixes)


def _judged(assembly: Setting, found: Certified, listed: list[Assumption], radius: Floats) -> Verdict:
    """The verdict of a bound."""
    settled = settled_from(found)
    worst = np.max(found.share, axis=0)
    fails = any(one.status == "fails" for one in listed)
    joint = int(np.argmax(worst))
    k = int(np.argmax(found.share[:, joint]))
    law = assembly.subject.law
    names, units = law.nominal.joint_names, law.nominal.joint_units
    missed = found.bounds.missed / assembly.horizon**2
    statement = (
        f"the error of `{names[joint]}` reaches at most {worst[joint]:.2g} of its envelope's side, at "
        f"t = {found.narrowing.times[k]:.3g} s; there the plan misses at most {missed[k, joint]:.3g} {units[joint]}/s² "
        "(docs/certificates/loop-rate.md, (8))"
    )
    holds = bool(np.max(worst) < 1.0) and not fails
    since, narrow = (float(found.narrowing.times[one]) for one in (0, settled))
    error = np.max(found.error[settled:], axis=(0, 1))
    if holds:
        each = ", ".join(f"{one:.2g}" for one in error)
        statement = (
            f"For {of_whom(assembly)}, at each sample from t = {since:.3g} s on the error is inside its envelope, and "
            f"from t = {narrow:.3g} s on at most {each} {' or '.join(dict.fromkeys(units))}, as far as the lines below "
            f"hold: {statement}"
        )
    bound = {
        "w_bar": np.max(missed[settled:], axis=0),
        "error_bound": error,
        "required_radius": radius,
        "share": worst,
        "noise": found.noise,
        "from": narrow,
        "since": since,
        "kappa": np.asarray(assembly.demand.kappa),
        **_over_time(assembly, found),
    }
    final = np.broadcast_to(np.asarray(assembly.subject.drawn.performance.final), radius.shape)
    if holds and not (radius <= final).all():
        # No joint's alone is known to hold with the others' of the envelope that does.
        bound["required_radius"] = np.array(final)
    return Verdict(NAME, TITLE, holds, float(1.0 - np.max(worst)), bound, listed, statement)


def _over_time(assembly: Setting, found: Certified) -> dict[str, Floats]:
    """The bound of |e| at some times, each the largest until the next."""
    e = np.max(found.error, axis=1)
    first = np.unique(np.linspace(0, len(e) - 1, INSTANTS).astype(int))
    return {"times": assembly.set_in[first], "error_over_time": np.maximum.reduceat(e, first)}


def settled_from(found: Certified) -> int:
    """The first sample at which all envelopes are as narrow as at the end, or nearly; the last quarter at the latest.

    - `found`: the bounds of a scenario.
    """
    narrow = np.all(found.narrowing.radius <= NARROW * found.narrowing.radius[-1], axis=1)
    first = int(np.argmax(narrow)) if narrow.any() else narrow.size - 1
    return min(first, (3 * narrow.size) // 4)


def _asked_radius(found: Certified) -> Floats:
    """The final radius that this bound would need [n]: it hardly depends on it where the surface is steep."""
    sides = np.stack([-found.narrowing.lower, found.narrowing.upper])
    return np.max(found.error[settled_from(found) :] / sides[None], axis=(0, 1))


def _least_radius(scenario: Scenario, whole: Proved, chance: float) -> Floats:
    """The smallest final radii that were found to hold, all joints' at once [n]; nan where none is found."""
    assert whole.found is not None
    radius = 1.1 * _asked_radius(whole.found)
    for _ in range(TRIES if scenario.controller.joints <= FEW else 1):
        if _share_of(altered(scenario, {"scheme.performance.final": _rounded(radius)}), chance) < 1.0:
            return np.array(_rounded(radius))
        radius = 1.5 * radius
    return np.full_like(radius, np.inf if whole.holds else np.nan)


def _rounded(radius: Floats) -> list[float]:
    return [float(f"{one:.3g}") for one in radius]


def _share_of(scenario: Scenario | None, chance: float) -> float:
    """The largest share of an envelope's side that may be reached; inf where no bound is found."""
    subject = "" if scenario is None else Subject.of(scenario)
    if isinstance(subject, str):
        return float("inf")
    try:
        whole = proved(subject, chance)
    except DefinitionError:
        return float("inf")
    if isinstance(whole, str) or whole.found is None:
        return float("inf")
    return float(np.max(whole.found.share)) if whole.holds else float("inf")


def _for_a_set(scenario: Scenario, whole: Proved, chance: float, radius: Floats | None = None) -> list[Remedy]:
    """What alone would make it hold."""
    found = []
    if radius is not None and np.isfinite(radius).all():
        found.append(Remedy("a wider final radius", {"scheme.performance.final": _rounded(radius)}))
    if scenario.controller.joints <= FEW and not scenario.changed:
        found += tried(scenario, lambda other: _share_of(other, chance))

    def share(part: float) -> float:
        smaller = of_a_part(whole, part, chance)
        return 0.0 if smaller.holds else float("inf")

    few = scenario.controller.joints <= FEW
    part = least(share, 1.0, 0.05) if few else next((one for one in PARTS if share(one) < 1.0), None)
    if part is not None:
        found.append(Remedy(f"{part:.2g} of what is uncertain, such as the payload", {}))
    return found


def _of_the_demand(whole: Proved) -> list[Assumption]:
    """The lines of what is asked for; for many joints K has a line of its own."""
    together = isinstance(whole.assembly, Coupled)
    return [*whole.demand.assumptions, *(() if together else whole.demand.of_kappa)]


def _unbounded(whole: Proved, fixes: list[Remedy]) -> Verdict:
    """Where what is asked for beside the planned run feeds on itself."""
    kappa, coupling = np.asarray(whole.demand.kappa), float(np.max(whole.demand.coupling))
    if isinstance(whole.assembly, Coupled):
        grows = "what K is not known to, and what is asked beside the planned run, grows"
    else:
        grows = "the sums of the responses' sizes grow"
    text = "what the arms ask for beside the planned run has a bound that confirms itself"
    statement = (
        f"No bound of the error was found: with κ from {kappa.min():.2g} to {kappa.max():.2g}, and joints that move "
        f"each other with up to {coupling:.2g} of their accelerations, {grows} from "
        "sample to sample (docs/certificates/loop-rate.md). Nothing is said of whether the envelope holds; "
        "`statistical` has runs"
    )
    listed = [*whole.premises, *_of_the_demand(whole), Assumption(text, "fails")]
    return Verdict(NAME, TITLE, False, None, {"kappa": kappa}, listed, statement, fixes)


def _unstable_together(whole: Proved) -> Verdict:
    assert isinstance(whole.assembly, Coupled)
    found = whole.assembly.forgetting
    time = float(whole.assembly.set_in[min(found.then, whole.assembly.samples - 1)])
    text = "the loops of all joints together forget what they knew within 2048 periods, with K as it moves"
    statement = (
        f"the loops of the joints together do not settle along the motion: at t = {time:.3g} s an error of one joint "
        f"{found.apart} periods before has become up to {found.grown:.3g} times as large in another, where joints of a "
        "wrongly known inertia move each other (docs/certificates/loop-rate.md)"
    )
    listed = [*whole.premises, Assumption(text, "fails", found.grown)]
    return Verdict(NAME, TITLE, False, None, {"grown": np.array(found.grown)}, listed, statement)


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
    listed = [*assembly.demand.of_kappa, Assumption(text, "fails", float(radius[joint]))]
    return Verdict(NAME, TITLE, False, None, {"radius": radius}, listed, statement)
