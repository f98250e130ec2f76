"""Refusals: the reason why no design exists, and changes of the requirements that were tried and work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slidax.analysis.cause import Remedy
from slidax.certify.certificate import Verdict
from slidax.certify.uncertainty_set import set_ends
from slidax.core.errors import DefinitionError
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description
from slidax.scenarios.scenario import ScenarioDescription

from .candidates import LARGEST, DesignPoint, DesignSpace, round_for_file
from .problem import DesignProblem
from .proof import DriveDemand, EstimationError, certified_radii, error_in_cases, tracking_verdict
from .search import LEAST_MARGIN, MANY, SPARE
from .trials import LOAD, Trials, WorstCase

FASTER = (0.7, 0.5, 0.35)
"""Times the period."""

LESS = (0.75, 0.5, 0.25, 0.0)
"""Of the width of a payload's set."""

LATER = (1.25, 1.5, 2.0, 3.0)
"""Times the deadline."""

FINER = (0.3, 0.1, 0.03)
"""Times the encoders' resolution."""

SLOWER = (1.25, 1.6, 2.0, 3.0)
"""Times the duration of the motion."""


@dataclass(frozen=True)
class Refusal:
    """Reason why no law exists.

    - `reason`: one sentence with the joint, and the number against its limit.
    - `would_do`: changes of the requirements with which there is one, each by itself.
    - `missed`: what each joint misses against the loop-rate rule; None where that is not the reason.
    """

    reason: str
    would_do: Sequence[Remedy]
    missed: EstimationError | None = None

    def as_json(self) -> dict[str, Any]:
        """As `slidax design --json` prints it."""
        changes = [{"words": item.words, "set": dict(item.changes)} for item in self.would_do]
        missed = {} if self.missed is None else {"missed": self.missed.as_json()}
        return {"designed": False, "reason": self.reason, "would_do": changes, **missed}


def refused(reason: str, would_do: list[Remedy], missed: EstimationError | None = None) -> Refusal:
    """A refusal.

    - `reason`: a sentence without its full stop.
    - `would_do`: what was found to do.
    - `missed`: what each joint misses, if that is why.
    """
    words = ", or ".join(item.words for item in would_do)
    return Refusal(f"{reason}.{f' {words[:1].upper()}{words[1:]} would do.' if words else ''}", would_do, missed)


def torque_refusal(problem: DesignProblem, demand: DriveDemand) -> Refusal:
    """The motion needs more than the drives have.

    - `requirements`: which ask for it.
    - `demand`: on the drives.
    """
    arm = problem.robot.build().nominal
    k = int(np.argmax(demand.torque / demand.limit))
    name, unit = arm.joint_names[k], arm.torque_units[k]
    reason = (
        f"the motion cannot be had for all of the set: `{name}` needs up to {demand.torque[k]:.3g} {unit} along it "
        f"(limit: {demand.limit[k]:.3g})"
    )
    enough = [float(f"{item:.3g}") for item in np.maximum(1.15 * demand.torque, demand.limit)]
    words = f"drives of {enough[k]:.3g} {unit} at that joint"
    return refused(reason, [Remedy(words, {"actuator.torque": enough})])


def deadline_refusal(trials: Trials, best: WorstCase) -> Refusal:
    """No law keeps the envelope until its deadline.

    - `trials`: on what.
    - `best`: the best of them.
    """
    deadline, cases = best.choice.deadline, trials.cases(MANY)
    later = [replace(best.choice, deadline=factor * deadline) for factor in LATER]
    later = [item for item in later if item.deadline < 0.8 * trials.base.simulation.t1]
    result = [item for item in (trials.judged(later, cases) if later else []) if item.holds]
    would = []
    if result:
        soonest = result[0].choice.deadline
        would.append(Remedy(f"a deadline of {soonest:.3g} s", {"requirements.deadline": soonest}))
    reason = (
        f"no law that was tried keeps its envelope at {1.0 / trials.frame.period:g} Hz with a deadline of "
        f"{deadline:g} s: the best leaves it in {best.outside} of {best.cases} cases, first at {_joint(trials, best)}"
    )
    return refused(reason, [*would, *_payload(trials, best, cases)])


def torque_step_refusal(trials: Trials, best: WorstCase, required: float, check: Verdict | None = None) -> Refusal:
    """The calmest law is not calm enough.

    - `trials`: on what.
    - `best`: the calmest.
    - `required`: largest change of torque from sample to sample [N m].
    - `check`: of cases that were not seen before, if that is why.
    """
    step, cases = (best.step, best.cases) if check is None else (check.bound["steady_torque_step"], check.bound["runs"])
    reason = (
        f"a torque step of {required:g} N m cannot be had at {1.0 / trials.frame.period:g} Hz: the calmest law "
        f"that was tried has {step:.3g} N m in the worst of {cases} cases"
    )
    smallest = float(f"{1.15 * step:.2g}")
    return refused(reason, [Remedy(f"{smallest:g} N m", {"requirements.torque_step": smallest})])


def accuracy_refusal(trials: Trials, best: WorstCase, held: WorstCase | None, check: Verdict | None = None) -> Refusal:
    """The final radius is too small.

    - `trials`: on what.
    - `best`: the law with the radius that is required.
    - `held`: the smallest radius that held; None if none did.
    - `check`: of cases that were not seen before, if that is why.
    """
    final = float(np.min(best.choice.final))
    unit = trials.problem.robot.build().nominal.joint_units[best.joint]
    where = f"accuracy {final:.2g} {unit} at {1.0 / trials.frame.period:g} Hz"
    missed = error_in_cases(trials, best.choice)
    if check is not None:
        text = f"of {check.bound['runs']} random cases {check.bound['failures']} leave it"
        if not check.bound["failures"]:
            text = f"of {check.bound['runs']} random cases none leaves it, but one of a search does"
    else:
        text = f"{best.outside} of {best.cases} cases leave it, first {_joint(trials, best)}"
        if not best.outside:
            text = f"{_joint(trials, best)} comes too near to it"
    text = ", and ".join(item for item in (missed.in_words(), text) if item)
    would = []
    if held is not None:
        wider = float(f"{SPARE * float(np.min(held.choice.final)):.2g}")
        would.append(Remedy(f"{wider:g} {unit}", {"requirements.accuracy": _scaled(trials, wider / final)}))
    would += [*_rates(trials, best), *_payload(trials, best, trials.cases(MANY))]
    return refused(f"{where} cannot be had: {text}", would, missed)


def proof_refusal(problem: DesignProblem, frame: DesignSpace, choice: DesignPoint, verdict: Verdict) -> Refusal:
    """A bound of the error is required, and there is none.

    - `choice`: the best law. `verdict`: what `tracking_bound` says of it.
    """
    description, largest = frame.described(choice), LARGEST * frame.initial
    best = problem.requirements.accuracy == "best"

    def holds(changes: dict[str, Any]) -> bool:
        try:
            changed = replace(frame, base=alter_description(frame.base, changes))
        except DefinitionError:
            return False
        law = replace(choice, final=largest) if best else choice
        return tracking_verdict(changed.described(law)).holds is True

    would: list[Remedy] = []
    if not best:
        wider = certified_radii(choice, lambda law: tracking_verdict(frame.described(law)), largest)
        if wider is not None:
            radius = round_for_file(wider[0].final)
            would.append(Remedy(f"an accuracy of {max(radius):.3g}", {"requirements.accuracy": radius}))
    for remedies in (_payload_told(problem, frame), _finer(description), _slower(problem, description)):
        would += next(([remedy] for remedy, changes in remedies if holds(changes)), [])
    would.append(Remedy("what is tested in simulation alone", {"requirements.proof": "tested"}))
    return refused(f"a bound is required, and `tracking_bound` gives none: {verdict.statement.rstrip('.')}", would)


Changed = Iterator[tuple[Remedy, dict[str, Any]]]
"""Changes of the requirements, each with the same change of a scenario."""


def _payload_told(problem: DesignProblem, frame: DesignSpace) -> Changed:
    """A law that knows the payload in the middle of its set, where it knew of none."""
    path, robot = f"robot.plant.{LOAD}", problem.robot.model_dump(exclude_unset=True)
    if path not in problem.uncertainty or (robot.get("nominal") or {}).get("load") is not None:
        return
    space = Family.of(frame.base).uncertain
    mass = float(f"{float(np.mean(set_ends(space.sets[path], space.leaves[path]))):.3g}")
    told = {"robot.nominal.load": {**robot["plant"]["load"], "mass": mass}}
    yield Remedy(f"a law that is told of {mass:g} kg at its tip", told), told


def _finer(description: ScenarioDescription) -> Changed:
    """Encoders of a finer resolution."""
    own = np.asarray(description.sensor.resolution, float)
    for factor in FINER if own.any() else ():
        value = np.vectorize(lambda number: float(f"{number:.2g}"))(factor * own).tolist()
        changes = {"sensor.resolution": value}
        yield Remedy(f"encoders of {np.max(value):.2g}", changes), changes


def _slower(problem: DesignProblem, description: ScenarioDescription) -> Changed:
    """The same way in more time."""
    block = description.trajectory.model_dump(exclude_unset=True)
    for factor in SLOWER:
        changes = {
            f"trajectory.{name}": (np.asarray(block[name], float) * factor**power).tolist()
            for name, power in TIMED.items()
            if isinstance(block.get(name), list | float | int)
        }
        if not changes:
            return
        told = changes
        if problem.workspace is not None:
            speed, acceleration = problem.workspace.speed, problem.workspace.acceleration
            told = {
                "workspace.speed": (np.asarray(speed, float) / factor).tolist(),
                "workspace.acceleration": (np.asarray(acceleration, float) / factor**2).tolist(),
            }
        yield Remedy(f"a motion {factor:g} times as long", told), changes


TIMED = {"times": 1, "frequency": -1, "rates": -1, "velocity": -1, "acceleration": -2, "jerk": -3}
"""Numbers of a trajectory that change with its duration, with their power."""


def _rates(trials: Trials, best: WorstCase) -> Iterator[Remedy]:
    """The slowest faster loop with which it holds."""
    for factor in FASTER:
        period = float(f"{factor * trials.frame.period:.3g}")
        horizon = float(f"{max(factor * best.choice.horizon, 2.0 * period):.4g}")
        first = replace(best.choice, horizon=horizon)
        other = Trials(trials.problem, trials.frame.at_period(period, trials.problem.t1), first)
        try:
            (tried,) = other.judged([first], other.cases(MANY))
        except DefinitionError:
            return
        if tried.holds and tried.margin >= LEAST_MARGIN:
            yield Remedy(f"{1.0 / period:.4g} Hz", {"simulation.period": period})
            return


def _payload(trials: Trials, best: WorstCase, cases: Any) -> Iterator[Remedy]:
    """The largest payload with which it holds."""
    path = trials.payload
    if path is None:
        return
    for share in LESS:
        less = trials.with_less({path: share})
        values = less.cases(MANY)
        (tried,) = less.judged([best.choice], values)
        if tried.holds and tried.margin >= LEAST_MARGIN:
            low, high = float(np.min(values[path])), float(np.max(values[path]))
            yield Remedy(f"a payload of at most {high:.3g} kg", {f"uncertainty.{path}": {"between": [low, high]}})
            return


def _scaled(trials: Trials, factor: float) -> Any:
    required = trials.problem.requirements.accuracy
    if required == "best":
        return "best"
    numbers = np.asarray(required, float) * factor
    return [float(f"{item:.2g}") for item in numbers] if numbers.ndim else float(f"{float(numbers):.2g}")


def _joint(trials: Trials, worst: WorstCase) -> str:
    return f"`{trials.problem.robot.build().nominal.joint_names[worst.joint]}`"
