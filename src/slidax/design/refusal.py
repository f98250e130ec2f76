"""Refusals: the reason why no law meets the requirements, and changes of them that were tried and help."""

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
"""Factors of the sampling period to try."""

LESS = (0.75, 0.5, 0.25, 0.0)
"""Shares of the width of a payload's set to try."""

LATER = (1.25, 1.5, 2.0, 3.0)
"""Factors of the deadline to try."""

FINER = (0.3, 0.1, 0.03)
"""Factors of the encoders' resolution to try."""

SLOWER = (1.25, 1.6, 2.0, 3.0)
"""Factors of the motion's duration to try."""


@dataclass(frozen=True)
class Refusal:
    """Reason why no law meets the requirements, with remedies.

    - `reason`: sentences with the joint, the value and its limit, and the remedies.
    - `would_do`: remedies: changes of the requirements, of which each alone makes a law possible.
    - `missed`: estimation errors and their limits by the loop-rate rule; None if they are not the reason.
    """

    reason: str
    would_do: Sequence[Remedy]
    missed: EstimationError | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the refusal as `slidax design --json` prints it."""
        changes = [{"words": item.words, "set": dict(item.changes)} for item in self.would_do]
        missed = {} if self.missed is None else {"missed": self.missed.as_json()}
        return {"designed": False, "reason": self.reason, "would_do": changes, **missed}


def refused(reason: str, would_do: list[Remedy], missed: EstimationError | None = None) -> Refusal:
    """Return a refusal whose reason also names the remedies.

    - `reason`: a sentence without its full stop.
    - `would_do`: remedies, of which each alone makes a law possible.
    - `missed`: estimation errors, if they are the reason.
    """
    words = ", or ".join(item.words for item in would_do)
    return Refusal(f"{reason}.{f' {words[:1].upper()}{words[1:]} would do.' if words else ''}", would_do, missed)


def torque_refusal(problem: DesignProblem, demand: DriveDemand) -> Refusal:
    """Return the refusal of a motion that needs more torque than the drives have.

    - `problem`: the arm and its motion.
    - `demand`: largest torque along the motion, and the drives' limit.
    """
    arm = problem.robot.build().nominal
    k = int(np.argmax(demand.torque / demand.limit))
    name, unit = arm.joint_names[k], arm.torque_units[k]
    reason = (
        f"the drives are too weak for the motion with some arms of the uncertainty set: `{name}` needs up to "
        f"{demand.torque[k]:.3g} {unit} (limit: {demand.limit[k]:.3g})"
    )
    enough = [float(f"{item:.3g}") for item in np.maximum(1.15 * demand.torque, demand.limit)]
    words = f"drives of {enough[k]:.3g} {unit} at that joint"
    return refused(reason, [Remedy(words, {"actuator.torque": enough})])


def deadline_refusal(trials: Trials, best: WorstCase) -> Refusal:
    """Return the refusal of a deadline for which no law keeps its envelope, with remedies.

    - `trials`: simulates the laws.
    - `best`: the best law that was tried, which leaves its envelope.
    """
    deadline, cases = best.choice.deadline, trials.cases(MANY)
    later = [replace(best.choice, deadline=factor * deadline) for factor in LATER]
    later = [item for item in later if item.deadline < 0.8 * trials.base.simulation.t1]
    result = [item for item in (trials.evaluate(later, cases) if later else []) if item.holds]
    would = []
    if result:
        soonest = result[0].choice.deadline
        would.append(Remedy(f"a deadline of {soonest:.3g} s", {"requirements.deadline": soonest}))
    reason = (
        f"no law that was tried keeps its envelope at {1.0 / trials.space.period:g} Hz with a deadline of "
        f"{deadline:g} s: the best leaves it in {best.outside} of {best.cases} cases, first at {_joint(trials, best)}"
    )
    return refused(reason, [*would, *_smaller_payload(trials, best)])


def torque_step_refusal(trials: Trials, best: WorstCase, required: float, check: Verdict | None = None) -> Refusal:
    """Return the refusal of a required torque step that no law meets, with a remedy.

    A torque step is the torque's change from sample to sample in the steady state.

    - `trials`: simulates the laws.
    - `best`: the law with the smallest torque step.
    - `required`: largest allowed torque step [N m].
    - `check`: the check by new cases, if the law failed there.
    """
    step, cases = (best.step, best.cases) if check is None else (check.bound["steady_torque_step"], check.bound["runs"])
    reason = (
        f"a torque step of {required:g} N m is not reached at {1.0 / trials.space.period:g} Hz: the best law that was "
        f"tried has {step:.3g} N m in the worst of {cases} cases"
    )
    smallest = float(f"{1.15 * step:.2g}")
    return refused(reason, [Remedy(f"a torque step of {smallest:g} N m", {"requirements.torque_step": smallest})])


def accuracy_refusal(trials: Trials, best: WorstCase, held: WorstCase | None, check: Verdict | None = None) -> Refusal:
    """Return the refusal of an accuracy that no law reaches, with remedies.

    - `trials`: simulates the laws.
    - `best`: the law with the required final radius.
    - `held`: the law with the smallest final radius that holds; None if none holds.
    - `check`: the check by new cases, if the law failed there.
    """
    final = float(np.min(best.choice.final))
    unit = trials.problem.robot.build().nominal.joint_units[best.joint]
    where = f"an accuracy of {final:.2g} {unit} at {1.0 / trials.space.period:g} Hz"
    missed = error_in_cases(trials, best.choice)
    if check is not None:
        text = f"of {check.bound['runs']} random cases {check.bound['failures']} leave the envelope"
        if not check.bound["failures"]:
            text = (
                f"a search finds a case that leaves the envelope, but none of {check.bound['runs']} random cases does"
            )
    else:
        text = f"{best.outside} of {best.cases} cases leave the envelope, first at {_joint(trials, best)}"
        if not best.outside:
            text = f"{_joint(trials, best)} comes too near the edge of its envelope"
    text = ", and ".join(item for item in (missed.in_words(), text) if item)
    would = []
    if held is not None:
        wider = float(f"{SPARE * float(np.min(held.choice.final)):.2g}")
        would.append(
            Remedy(f"an accuracy of {wider:g} {unit}", {"requirements.accuracy": _scaled(trials, wider / final)})
        )
    would += [*_faster_loop(trials, best), *_smaller_payload(trials, best)]
    return refused(f"{where} is not reached: {text}", would, missed)


def proof_refusal(problem: DesignProblem, space: DesignSpace, choice: DesignPoint, verdict: Verdict) -> Refusal:
    """Return the refusal of a required error bound that `tracking_bound` cannot certify, with remedies.

    - `problem`: the requirements.
    - `space`, `choice`: common and searched values of the best law.
    - `verdict`: its verdict of `tracking_bound`.
    """
    description, largest = space.described(choice), LARGEST * space.initial
    best = problem.requirements.accuracy == "best"

    def holds(changes: dict[str, Any]) -> bool:
        try:
            changed = replace(space, base=alter_description(space.base, changes))
        except DefinitionError:
            return False
        law = replace(choice, final=largest) if best else choice
        return tracking_verdict(changed.described(law)).holds is True

    would: list[Remedy] = []
    if not best:
        wider = certified_radii(choice, lambda law: tracking_verdict(space.described(law)), largest)
        if wider is not None:
            radius = round_for_file(wider[0].final)
            would.append(Remedy(f"an accuracy of {max(radius):.3g}", {"requirements.accuracy": radius}))
    for remedies in (
        _known_payload(problem, space),
        _finer_encoders(description),
        _slower_motion(problem, description),
    ):
        would += next(([remedy] for remedy, changes in remedies if holds(changes)), [])
    would.append(Remedy("a law that is only tested in simulation", {"requirements.proof": "tested"}))
    return refused(f"a bound is required, and `tracking_bound` gives none: {verdict.statement.rstrip('.')}", would)


Changed = Iterator[tuple[Remedy, dict[str, Any]]]
"""Remedies for a requirements file, each with the corresponding changes of a scenario."""


def _known_payload(problem: DesignProblem, space: DesignSpace) -> Changed:
    """Propose a law that knows the mean payload, if the law knew no payload."""
    path, robot = f"robot.plant.{LOAD}", problem.robot.model_dump(exclude_unset=True)
    if path not in problem.uncertainty or (robot.get("nominal") or {}).get("load") is not None:
        return
    uncertain = Family.of(space.base).uncertain
    mass = float(f"{float(np.mean(set_ends(uncertain.sets[path], uncertain.leaves[path]))):.3g}")
    known = {"robot.nominal.load": {**robot["plant"]["load"], "mass": mass}}
    yield Remedy(f"a law that knows {mass:g} kg at the tip", known), known


def _finer_encoders(description: ScenarioDescription) -> Changed:
    """Propose encoders of a finer resolution."""
    own = np.asarray(description.sensor.resolution, float)
    for factor in FINER if own.any() else ():
        value = np.vectorize(lambda number: float(f"{number:.2g}"))(factor * own).tolist()
        changes = {"sensor.resolution": value}
        yield Remedy(f"encoders with a resolution of {np.max(value):.2g}", changes), changes


def _slower_motion(problem: DesignProblem, description: ScenarioDescription) -> Changed:
    """Propose the same path in more time."""
    block = description.trajectory.model_dump(exclude_unset=True)
    for factor in SLOWER:
        changes = {
            f"trajectory.{name}": (np.asarray(block[name], float) * factor**power).tolist()
            for name, power in TIMED.items()
            if isinstance(block.get(name), list | float | int)
        }
        if not changes:
            return
        requirements = dict(changes)
        if problem.start is None and description.start.dq is not None:
            # Without `start` the arm starts on the motion, so that a slower motion needs a slower start.
            changes["start.dq"] = (np.asarray(description.start.dq, float) / factor).tolist()
        if problem.workspace is not None:
            speed, acceleration = problem.workspace.speed, problem.workspace.acceleration
            requirements = {
                "workspace.speed": (np.asarray(speed, float) / factor).tolist(),
                "workspace.acceleration": (np.asarray(acceleration, float) / factor**2).tolist(),
            }
        yield Remedy(f"a motion {factor:g} times as long", requirements), changes


TIMED = {"times": 1, "frequency": -1, "rates": -1, "velocity": -1, "acceleration": -2, "jerk": -3}
"""Values of a trajectory, each with the power of the duration with which it scales."""


def _faster_loop(trials: Trials, best: WorstCase) -> Iterator[Remedy]:
    """Propose the longest period, of those shorter than the present one, for which the law holds."""
    for factor in FASTER:
        period = float(f"{factor * trials.space.period:.3g}")
        horizon = float(f"{max(factor * best.choice.horizon, 2.0 * period):.4g}")
        first = replace(best.choice, horizon=horizon)
        other = Trials(trials.problem, trials.space.at_period(period, trials.problem.t1), first)
        try:
            (tried,) = other.evaluate([first], other.cases(MANY))
        except DefinitionError:
            return
        if tried.holds and tried.margin >= LEAST_MARGIN:
            yield Remedy(f"a loop rate of {1.0 / period:.4g} Hz", {"simulation.period": period})
            return


def _smaller_payload(trials: Trials, best: WorstCase) -> Iterator[Remedy]:
    """Propose the largest payload for which the law holds."""
    path = trials.payload
    if path is None:
        return
    for share in LESS:
        less = trials.with_smaller_sets({path: share})
        values = less.cases(MANY)
        (tried,) = less.evaluate([best.choice], values)
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
