"""The certificate `loop_rate`: no sample leaves the envelope, for all members of an uncertainty set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.analysis.cause import Remedy
from slidax.core.errors import DefinitionError
from slidax.scenarios.scenario import Scenario

from ..arm.demand import Demand
from ..certificate import ARM, Assumption, Verdict, certificate
from ..sampled_scenario import Floats
from .bound_recursion import BoundProblem, CertifiedBounds
from .coupled_bound import CoupledProblem
from .decoupled_bound import DecoupledProblem
from .fixed_point import FINE, Fineness
from .problem import LoopProblem
from .remedies import nearest_value, resample_demand, scale_demand, search_remedies, try_remedies, with_changes
from .set_bound import BEGINNINGS, SetBound, bound_of_smaller_set, covered_members, loop_assumptions, set_bound

NAME, TITLE = "loop_rate", "no sample leaves its envelope at this rate"

NARROW = 1.05
"""Factor of the final width below which an envelope counts as narrow."""

TRIES = 3
"""Number of final radii tried for the smallest one, each 1.5 times the last."""

INSTANTS = 200
"""Number of times at which the bound over time is reported."""

FEW = 3
"""Largest number of joints for which other values of the law are tried as remedies, each with its own cases."""

PARTS = (0.5, 0.2)
"""Shares of the uncertainty set that are tried for more joints."""


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
    """Bound the tracking error at all samples and compare it with the envelope (docs/certificates/loop-rate.md).

    - `scenario`: with a law in sampled-data form with a plan and a linear estimator.
    - `demand`: of any set of arms along the reference; by default that of the scenario's set, along the law's planned
      run.
    - `chance`: probability that normal noise exceeds its bound at some sample of the run.
    - `remedies`: if True, search the smallest changes that make it hold, and the least final radius.
    - `beginnings`: where the bound of a set may begin, from 0, when all its cases keep s, to 1, when the envelope is
      narrow. The first one with which it holds counts.
    - `fineness`: of the bounds from four joints on.
    """
    subject = LoopProblem.of(scenario)
    if isinstance(subject, str):
        return Verdict(NAME, TITLE, None, None, {}, [], f"not applicable: {subject}")
    if demand is not None:
        return _of_a_demand(subject, demand, chance, remedies)
    whole = set_bound(subject, chance, beginnings, fineness)
    if isinstance(whole, str):
        text = "there is a time from which on all cases of the set keep s and their limits, inside the envelope"
        statement = f"No bound of the error was found: {whole}. The envelope may still hold"
        return Verdict(NAME, TITLE, False, None, {}, [Assumption(text, "fails")], statement)
    if not whole.assembly.stable:
        return _unstable(whole.assembly) if isinstance(whole.assembly, DecoupledProblem) else _unstable_together(whole)
    if whole.bounds is None:
        return _unbounded(whole, _for_a_set(scenario, whole, chance) if remedies else [])
    listed = [*whole.premises, *_of_the_demand(whole)]
    radius = _least_radius(scenario, whole, chance) if remedies else _required_radius(whole.bounds)
    verdict = _judged(whole.assembly, whole.bounds, listed, radius)
    if verdict.holds or not remedies:
        return verdict
    return Verdict(
        NAME, TITLE, verdict.holds, verdict.margin, verdict.bound, verdict.assumptions, verdict.statement,
        _for_a_set(scenario, whole, chance, radius),
    )  # fmt: skip


def _of_a_demand(subject: LoopProblem, demand: Demand, chance: float, remedies: bool) -> Verdict:
    assembly = DecoupledProblem(subject, demand, chance)
    if not assembly.stable:
        return _unstable(assembly)
    bounds = assembly.certified()
    radius = _required_radius(bounds)
    verdict = _judged(
        assembly, bounds, [*demand.assumptions, *demand.of_kappa, *loop_assumptions(assembly, bounds, chance)], radius
    )
    if verdict.holds or not remedies:
        return verdict

    def share(scenario: Scenario, part: float = 1.0) -> float:
        other = LoopProblem.of(scenario)
        if isinstance(other, str):
            return float("inf")
        resized = (
            demand
            if abs(scenario.period - subject.scenario.period) < 1e-12
            else resample_demand(demand, scenario.period)
        )
        bound = DecoupledProblem(other, scale_demand(resized, part), chance)
        return float(np.max(bound.certified().share)) if bound.stable else float("inf")

    fixes = search_remedies(subject.scenario, radius, share, lambda part: share(subject.scenario, part))
    return Verdict(NAME, TITLE, False, verdict.margin, verdict.bound, verdict.assumptions, verdict.statement, fixes)


def _judged(assembly: BoundProblem, certified: CertifiedBounds, listed: list[Assumption], radius: Floats) -> Verdict:
    """The verdict of a bound."""
    settled = settled_sample(certified)
    worst = np.max(certified.share, axis=0)
    fails = any(line.status == "fails" for line in listed)
    joint = int(np.argmax(worst))
    k = int(np.argmax(certified.share[:, joint]))
    law = assembly.subject.law
    names, units = law.nominal.joint_names, law.nominal.joint_units
    missed = certified.bounds.missed / assembly.horizon**2
    statement = (
        f"the error of `{names[joint]}` reaches at most {worst[joint]:.2g} of its envelope's side, at "
        f"t = {certified.narrowing.times[k]:.3g} s; there the estimation error is at most {missed[k, joint]:.3g} "
        f"{units[joint]}/s² (docs/certificates/loop-rate.md, (8))"
    )
    holds = bool(np.max(worst) < 1.0) and not fails
    since, narrow = (float(certified.narrowing.times[k]) for k in (0, settled))
    error = np.max(certified.error[settled:], axis=(0, 1))
    if holds:
        each = ", ".join(f"{value:.2g}" for value in error)
        statement = (
            f"For {covered_members(assembly)}, at each sample from t = {since:.3g} s on the error is inside its "
            f"envelope, and from t = {narrow:.3g} s on at most {each} {' or '.join(dict.fromkeys(units))}, under the "
            f"assumptions below: {statement}"
        )
    bound = {
        "w_bar": np.max(missed[settled:], axis=0),
        "error_bound": error,
        "required_radius": radius,
        "share": worst,
        "noise": certified.noise,
        "from": narrow,
        "since": since,
        "kappa": np.asarray(assembly.demand.kappa),
        **_over_time(assembly, certified),
    }
    final = np.broadcast_to(np.asarray(assembly.subject.drawn.performance.final), radius.shape)
    if holds and not (radius <= final).all():
        # No smaller radius of one joint alone is known to hold with those of the others.
        bound["required_radius"] = np.array(final)
    return Verdict(NAME, TITLE, holds, float(1.0 - np.max(worst)), bound, listed, statement)


def _over_time(assembly: BoundProblem, certified: CertifiedBounds) -> dict[str, Floats]:
    """The bound of |e| at some times, each the largest until the next."""
    e = np.max(certified.error, axis=1)
    first = np.unique(np.linspace(0, len(e) - 1, INSTANTS).astype(int))
    return {"times": assembly.set_in[first], "error_over_time": np.maximum.reduceat(e, first)}


def settled_sample(certified: CertifiedBounds) -> int:
    """Return the first sample with all envelopes at nearly their final width; the last quarter at the latest."""
    narrow = np.all(certified.narrowing.radius <= NARROW * certified.narrowing.radius[-1], axis=1)
    first = int(np.argmax(narrow)) if narrow.any() else narrow.size - 1
    return min(first, (3 * narrow.size) // 4)


def _required_radius(certified: CertifiedBounds) -> Floats:
    """Final radius that this bound would need [n]: it hardly depends on the radius where the surface is steep."""
    sides = np.stack([-certified.narrowing.lower, certified.narrowing.upper])
    return np.max(certified.error[settled_sample(certified) :] / sides[None], axis=(0, 1))


def _least_radius(scenario: Scenario, whole: SetBound, chance: float) -> Floats:
    """The smallest final radii found to hold, for all joints at once [n]; nan if none is found."""
    assert whole.bounds is not None
    radius = 1.1 * _required_radius(whole.bounds)
    for _ in range(TRIES if scenario.controller.joints <= FEW else 1):
        if _share_of(with_changes(scenario, {"scheme.performance.final": _rounded(radius)}), chance) < 1.0:
            return np.array(_rounded(radius))
        radius = 1.5 * radius
    return np.full_like(radius, np.inf if whole.holds else np.nan)


def _rounded(radius: Floats) -> list[float]:
    return [float(f"{value:.3g}") for value in radius]


def _share_of(scenario: Scenario | None, chance: float) -> float:
    """The largest reachable share of an envelope's side; inf if no bound is found."""
    subject = "" if scenario is None else LoopProblem.of(scenario)
    if isinstance(subject, str):
        return float("inf")
    try:
        whole = set_bound(subject, chance)
    except DefinitionError:
        return float("inf")
    if isinstance(whole, str) or whole.bounds is None:
        return float("inf")
    return float(np.max(whole.bounds.share)) if whole.holds else float("inf")


def _for_a_set(scenario: Scenario, whole: SetBound, chance: float, radius: Floats | None = None) -> list[Remedy]:
    """Remedies, each of which alone makes the bound hold."""
    fixes = []
    if radius is not None and np.isfinite(radius).all():
        fixes.append(Remedy("a wider final radius", {"scheme.performance.final": _rounded(radius)}))
    if scenario.controller.joints <= FEW and not scenario.changed:
        fixes += try_remedies(scenario, lambda other: _share_of(other, chance))

    def share(part: float) -> float:
        smaller = bound_of_smaller_set(whole, part, chance)
        return 0.0 if smaller.holds else float("inf")

    few = scenario.controller.joints <= FEW
    part = (
        nearest_value(share, 1.0, 0.05)
        if few
        else next((fraction for fraction in PARTS if share(fraction) < 1.0), None)
    )
    if part is not None:
        fixes.append(Remedy(f"{part:.2g} of the uncertainty, such as the payload's", {}))
    return fixes


def _of_the_demand(whole: SetBound) -> list[Assumption]:
    """Assumptions of the demand; for many joints K has a line of its own."""
    together = isinstance(whole.assembly, CoupledProblem)
    return [*whole.demand.assumptions, *(() if together else whole.demand.of_kappa)]


def _unbounded(whole: SetBound, fixes: list[Remedy]) -> Verdict:
    """The verdict if the deviation bound does not converge."""
    kappa, coupling = np.asarray(whole.demand.kappa), float(np.max(whole.demand.coupling))
    if isinstance(whole.assembly, CoupledProblem):
        grows = "the uncertainty of K and the demand of deviations from the nominal run grow"
    else:
        grows = "the sums of the responses' sizes grow"
    text = "the demand of deviations from the planned run has a self-consistent bound"
    statement = (
        f"No bound of the error was found: with κ from {kappa.min():.2g} to {kappa.max():.2g}, and joints that move "
        f"each other with up to {coupling:.2g} of their accelerations, {grows} from "
        "sample to sample (docs/certificates/loop-rate.md). The envelope may still hold; `statistical` tests it"
    )
    listed = [*whole.premises, *_of_the_demand(whole), Assumption(text, "fails")]
    return Verdict(NAME, TITLE, False, None, {"kappa": kappa}, listed, statement, fixes)


def _unstable_together(whole: SetBound) -> Verdict:
    assert isinstance(whole.assembly, CoupledProblem)
    memory = whole.assembly.forgetting
    time = float(whole.assembly.set_in[min(memory.then, whole.assembly.samples - 1)])
    text = "the coupled loop of all joints decays within 2048 periods, with its time-varying K"
    statement = (
        f"the loops of the joints together do not settle along the motion: at t = {time:.3g} s an error of one joint "
        f"has become up to {memory.grown:.3g} times as large in another within {memory.apart} periods, because joints "
        "with a wrong nominal inertia move each other (docs/certificates/loop-rate.md)"
    )
    listed = [*whole.premises, Assumption(text, "fails", memory.grown)]
    return Verdict(NAME, TITLE, False, None, {"grown": np.array(memory.grown)}, listed, statement)


def _unstable(assembly: DecoupledProblem) -> Verdict:
    radius = np.array(
        [
            max(loop.radius(float(kappa)) for kappa in row)
            for loop, row in zip(assembly.subject.loops, assembly.kappa, strict=True)
        ]
    )
    joint = int(np.argmax(radius))
    low, high = assembly.demand.kappa[:, joint]
    name = assembly.subject.law.nominal.joint_names[joint]
    text = "each loop decays within 4096 periods, for all κ of the set"
    statement = (
        f"the loop of `{name}` does not settle for all κ from {low:.2g} to {high:.2g} (modulus {radius[joint]:.4f} a "
        "period; see `inertia_ratio`)"
    )
    listed = [*assembly.demand.of_kappa, Assumption(text, "fails", float(radius[joint]))]
    return Verdict(NAME, TITLE, False, None, {"radius": radius}, listed, statement)
