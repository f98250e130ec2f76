"""From requirements to a certified scenario, or to a refusal; and the scenario file with its comments."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from os.path import relpath
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slidax.certify.certificate import Verdict
from slidax.certify.certify import Certificates
from slidax.certify.statistical import statistical_with_cases
from slidax.certify.uncertainty_set import start_box
from slidax.core.errors import DefinitionError
from slidax.core.tracing import require_64_bits
from slidax.core.types import Timing
from slidax.core.writing import write_text
from slidax.scenarios.draft import WIDTH
from slidax.scenarios.scenario import ScenarioDescription
from slidax.scenarios.yaml_text import dump_commented
from slidax.studies.search import require_cmaes

from .candidates import DRIFTS, LARGEST, DesignPoint, DesignSpace, design_space, template
from .problem import DesignProblem
from .proof import DriveDemand, certified_radii, drive_demand, tracking_verdict
from .refusal import Refusal, accuracy_refusal, deadline_refusal, proof_refusal, torque_refusal, torque_step_refusal
from .search import LEAST_MARGIN, MANY, MOST, SPARE, coarse_search, fine_search, narrowest_envelope
from .trials import CALM, DRIVEN, OWN, Objective, Trials, WorstCase

RUNS = 1000
"""Random cases of the check at the end, and as many of a search for the worst."""

TIMES, SLACK = 4, 1.5
"""Number of checks of a law, each with cases of its own, before it is refused; and what the final radius is each time
multiplied by besides, where it is not required."""

ENOUGH = 0.1
"""The margin that the worst case of the check must leave, but for the last, since a longer search finds worse ones."""

U_OVER, U_AMPLE = 1.15, 2.0
"""u over what the model lacks: where it is searched for at least, and where it is not."""

UNSEEN = 0.95
"""Of a torque step that is required, that the common cases may show: the many of the check show more."""

ROOM_LEFT = 0.12
"""Of an envelope's width, that the common cases must leave of one that is not widened by `SPARE`."""


NEAR = 0.05
"""rad or m: the envelope's width at the start for `tracking_bound`; a much wider one pulls too little."""

Proof = Literal["bound", "tested"]


@dataclass(frozen=True)
class DesignResult:
    """A law that meets the requirements.

    - `description`: the scenario with it.
    - `proof`: `bound` where `tracking_bound` holds in its envelope, else `tested`: in simulation alone.
    - `frame`, `choice`: its numbers; `worst`: what the worst common case makes of them.
    - `demand`: on the drives and on u; None where no bound was found.
    - `bound`: verdict of `tracking_bound`; None where no bound is required.
    - `check`: of random cases and a search, as the certificate `statistical`.
    - `runs`: that were simulated to find it.
    """

    description: ScenarioDescription
    proof: Proof
    frame: DesignSpace
    choice: DesignPoint
    worst: WorstCase
    demand: DriveDemand | None
    bound: Verdict | None
    check: Verdict
    runs: int

    @property
    def spared(self) -> float:
        """Margin of the check's worst case."""
        return float(self.check.bound.get("worst_margin", np.inf))


Design = DesignResult | Refusal
Say = Callable[[str], None]


def _unheard(_: str) -> None:
    """Nobody is told."""


def design(problem: DesignProblem, *, runs: int = RUNS, say: Say = _unheard) -> Design:
    """The law for an arm and its task, by the certificates where they have an answer, else by simulated cases.

    In closed form: ρ0 from the starts, T as required, u from `robust_torque`, H and the estimator's density in
    proportion to the period, the delay and the drives. Then a grid of H and density and three surfaces on the
    same eight cases of the set, and from the best of them a search of all these numbers, ϑ and ρ∞ at once; ρ∞ from
    `tracking_bound` if a bound is required, or the smallest that 48 cases held. Last, random cases that were not seen
    before and a search for the worst one; where one of them left, the second search begins anew with the worst among
    its cases.

    - `problem`: as `read_problem` gives it.
    - `runs`: random cases of the check at the end.
    - `say`: is told what is done.

    Raises DefinitionError if the requirements contradict themselves, the package for searches is missing, or JAX has
    32-bit numbers.
    """
    # The search for the worst case comes last, after minutes.
    require_cmaes()
    require_64_bits()
    frame, first = _begin(problem)
    if frame.along:
        say("laws with a bound along the motion")
        first, verdict = law_with_bound(frame, first)
        if not verdict.holds:
            return proof_refusal(problem, frame, first, verdict)
    say("what the motion and the set ask of the drives")
    request = _demand(frame, first)
    if request is not None:
        if (request.torque >= request.limit).any():
            return torque_refusal(problem, request)
        least, ample = (float(f"{request.needed * times:.4g}") for times in (U_OVER, U_AMPLE))
        if problem.requirements.torque_step is not None:
            # The search decides how much more: on the two-link arm three times as much is calmer, and more exact.
            frame, first = replace(frame, least_margin=least), replace(first, margin=max(request.u, least))
        elif ample > request.u:
            first = replace(first, margin=ample)
    say("horizon, estimator and surface on common cases")
    trials, best = _best(problem, frame, first)
    requirements = problem.requirements
    if not best.holds:
        return deadline_refusal(trials, best)
    if requirements.torque_step is not None and best.step > requirements.torque_step:
        return torque_step_refusal(trials, best, requirements.torque_step)
    say("the final radius")
    sized = _sized(problem, trials, best, _aim(problem, frame))
    if isinstance(sized, Refusal):
        return sized
    return _checked(problem, trials, sized, request, runs, say)


def _begin(problem: DesignProblem) -> tuple[DesignSpace, DesignPoint]:
    """Return the frame of all choices, and the first choice."""
    requirements, h = problem.requirements, problem.simulation.period
    base = problem.scenario(template(requirements.deadline))
    moving = base.moving()
    units = moving.arms.nominal.joint_units
    wide = np.array([WIDTH[unit] for unit in units])
    shape = (
        wide
        if requirements.accuracy == "best"
        else np.broadcast_to(np.asarray(requirements.accuracy, float), wide.shape)
    )
    starts = start_box(base.build("start"))
    frame = design_space(
        base,
        moving,
        (np.asarray(starts.lower), np.asarray(starts.upper)),
        np.asarray(shape, float),
        period=h,
        delay=Timing(h, problem.sensor.delay, problem.actuator.dead_time).total_delay,
        has_velocity=problem.sensor.has_velocity,
    )
    if requirements.proof == "bound":
        frame = replace(frame, along=True, initial=np.full(frame.initial.shape, NEAR))
    if (frame.shape >= LARGEST * frame.initial).any() and requirements.accuracy != "best":
        frame = replace(frame, initial=np.maximum(frame.initial, frame.shape / LARGEST))
    horizon, drift = frame.horizons[2 if len(frame.horizons) > 2 else -1], 1.0
    return frame, DesignPoint(horizon, drift, 1.0, _provisional(frame), requirements.deadline)


def law_with_bound(frame: DesignSpace, first: DesignPoint) -> tuple[DesignPoint, Verdict]:
    """The law with the smallest certified error of a grid of H and densities, and its verdict.

    Where none holds, a failing one: that with the fewest failing lines, and the longest H.

    - `first`: its other numbers.
    """
    results: list[tuple[int, float, int]] = []
    laws: list[tuple[DesignPoint, Verdict]] = []
    for horizon, drift in product(frame.horizons, DRIFTS):
        law = replace(first, horizon=horizon, drift=drift, final=LARGEST * frame.initial)
        verdict = tracking_verdict(frame.described(law))
        failing = 0 if verdict.holds else 1 + sum(line.status == "fails" for line in verdict.assumptions)
        error = float(np.max(verdict.bound["error"])) if verdict.holds else -horizon
        results.append((failing, error, len(results)))
        laws.append((replace(law, final=first.final), verdict))
    return laws[min(results)[2]]


def _provisional(frame: DesignSpace) -> Any:
    """Final radii of the search, in which the steady error hardly depends on them."""
    wide = frame.radius * np.where(frame.initial > 0, frame.initial / frame.initial.max(), 1.0)
    return np.minimum(np.maximum(4.0 * wide, frame.shape if frame.shape.max() < 0.1 else 0.0), LARGEST * frame.initial)


def _demand(frame: DesignSpace, first: DesignPoint) -> DriveDemand | None:
    try:
        return drive_demand(frame.described(first).build("demand"))
    except DefinitionError:
        return None


def _aim(problem: DesignProblem, frame: DesignSpace) -> Objective:
    """Return the objective of the search."""
    requirements = problem.requirements
    small = None if requirements.accuracy == "best" else float(np.min(frame.shape)) / (2.0 * SPARE)
    step = requirements.torque_step
    room = ROOM_LEFT if requirements.accuracy == "best" else LEAST_MARGIN
    most = min(DRIVEN * float(np.max(frame.changes)), np.inf if step is None else UNSEEN * step)
    return Objective(most, step is not None, small, room, OWN if requirements.proof == "bound" else np.inf)


def _best(problem: DesignProblem, frame: DesignSpace, first: DesignPoint) -> tuple[Trials, WorstCase]:
    """The best law with the better estimator, where velocities are measured."""
    aim, result = _aim(problem, frame), []
    for kalman in (True, False) if frame.has_velocity else (True,):
        trials = Trials(problem, frame, first if kalman else replace(first, drift=None))
        result.append((trials, coarse_search(trials, aim, kalman=kalman)))
    trials, best = min(result, key=lambda item: aim.cost(item[1]))
    return trials, fine_search(trials, best, aim)


def _sized(problem: DesignProblem, trials: Trials, best: WorstCase, aim: Objective) -> WorstCase | Refusal:
    """The law with its final radius."""
    frame, requirements = trials.frame, problem.requirements
    if requirements.accuracy == "best":
        held = narrowest_envelope(trials, best, CALM * aim.step if aim.required else np.inf)
        result = [best] if best.holds and best.margin >= ROOM_LEFT else []
        if held is not None:
            wider = np.minimum(SPARE * held.choice.final, trials.most * frame.shape)
            result += trials.judged([replace(held.choice, final=wider)], trials.cases(MOST))
        return aim.best(result) if result else accuracy_refusal(trials, best, None)
    (required,) = trials.judged([replace(best.choice, final=frame.shape)], trials.cases(MANY))
    if required.holds and required.margin >= LEAST_MARGIN:
        return required
    return accuracy_refusal(trials, required, narrowest_envelope(trials, best))


def _checked(
    problem: DesignProblem, trials: Trials, worst: WorstCase, request: DriveDemand | None, runs: int, say: Say
) -> Design:
    """The same after its certificate and its check; where a case left or came near, another law that bears it, too.

    So it is where one had a larger torque step than is required.
    """
    best, required = problem.requirements.accuracy == "best", problem.requirements.torque_step
    aim = _aim(problem, trials.frame)
    kept: DesignResult | None = None
    for turn in range(TIMES):
        choice: DesignPoint = worst.choice
        bound: Verdict | None = None
        if best and turn:
            wider = np.minimum(SLACK**turn * choice.final, LARGEST * trials.frame.initial)
            choice = replace(choice, final=np.maximum(choice.final, wider))
        if trials.frame.along:
            say("the bound along the motion")
            choice, bound = _certified(trials.frame, choice, best)
            if not bound.holds:
                # The search looks at simulated errors alone, and may leave the laws with a bound.
                choice, bound = _certified(trials.frame, replace(trials.first, final=choice.final), best)
                (worst,) = trials.judged([choice], trials.cases(MOST))
            if not bound.holds:
                return proof_refusal(problem, trials.frame, choice, bound)
        say(f"{2 * runs} cases that were not seen before")
        description = _described(trials.frame, choice, worst)
        check, hard = statistical_with_cases(description.build("design"), runs, seed=1 + turn)
        wild = 1.0 if required is None else check.bound.get("steady_torque_step", 0.0) / required
        if check.holds is not False and wild <= 1.0:
            proof: Proof = "tested" if bound is None else "bound"
            built = DesignResult(description, proof, trials.frame, choice, worst, request, bound, check, trials.runs)
            kept = built if kept is None or built.spared > kept.spared else kept
            if not best or check.holds is None or built.spared >= ENOUGH:
                return built
        if turn == TIMES - 1:
            break
        say("a law for the hardest of them, too")
        # The largest of many cases is a rare one, which a law that is half as much calmer may not show.
        trials, aim = trials.with_harder(hard), aim.stricter(float(np.sqrt(CALM / wild)) if wild > 1.0 else 1.0)
        sized = _sized(problem, trials, fine_search(trials, worst, aim), aim)
        if isinstance(sized, Refusal):
            return kept or sized
        worst = sized
    if kept is None and required is not None and wild > 1.0:
        return torque_step_refusal(trials, worst, required, check)
    return kept or accuracy_refusal(trials, worst, None, check)


def _certified(frame: DesignSpace, choice: DesignPoint, best: bool) -> tuple[DesignPoint, Verdict]:
    """A law and its verdict of `tracking_bound`; with `best`, with the smallest final radius for which this holds."""

    def verdict_of(law: DesignPoint) -> Verdict:
        return tracking_verdict(frame.described(law))

    wider = certified_radii(choice, verdict_of, LARGEST * frame.initial) if best else None
    return wider or (choice, verdict_of(choice))


def _described(frame: DesignSpace, choice: DesignPoint, worst: WorstCase) -> ScenarioDescription:
    """The scenario of a choice; its monitor is as strict as the common cases allow."""
    used = float(np.clip(1.25 * (1.0 - worst.promise), 0.3, 1.0))
    return frame.described(choice, float(f"{used:.2g}"))


CERTIFICATE = ".certificate.json"
"""Follows the scenario's own name."""


def written(result: DesignResult, folder: Path) -> str:
    """Return the scenario as YAML with comments, ready for `slidax run`.

    - `folder`: of the file, from which it names other files.
    """
    values = result.description.model_dump(mode="json", exclude_unset=True)
    for name in ("robot", "trajectory"):
        values[name] = _relative(values[name], folder)
    return dump_commented(values, _comments(result))


def write_design(result: DesignResult, out: Path, certificates: Certificates) -> Path:
    """Write the scenario to `out` and its certificates next to it; return the path of the certificates."""
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, written(result, out.parent))
    path = out.with_name(out.stem + CERTIFICATE)
    text = json.dumps(certificates.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(path, text + "\n")
    return path


def name_proof(verdict: Verdict | None) -> str:
    """Name the proof of a design for a verdict that holds: certified if all lines are proved."""
    if verdict is None or verdict.grade is None:
        return "tested"
    if verdict.grade == "A":
        return f"certified by `{verdict.name}`, grade A: all of its lines are proved"
    return f"tested, with a bound of `{verdict.name}`, grade {verdict.grade}: its lines: {verdict.stands_on}"


def _proof(result: DesignResult) -> str:
    check = result.check.bound
    text = "Tested in simulation, not proved: the law learns, and `proof: bound` looks for a law with a bound."
    if result.proof == "bound":
        name = name_proof(result.bound)
        text = f"{name[0].upper()}{name[1:]}; the certificate file next to this one lists its lines."
    if not check:
        return f"{text} Nothing is uncertain, so that one run shows all."
    return (
        f"{text} {check['runs']} random cases of the set and {check['searched']} of a search for the worst stay "
        f"inside, the worst with {check['worst_margin']:.2g} of the envelope's width to spare."
    )


def _comments(result: DesignResult) -> Iterator[tuple[str, str]]:
    """Yield the path of each key with its comment."""
    frame, choice = result.frame, result.choice
    yield "robot", _proof(result)
    yield (
        "scheme.transformation.performance",
        f"The error is within `final` from the deadline on. In the worst of {result.worst.cases} common cases the "
        f"steady error is {result.worst.error:.2g}. `initial` has room for all starts.",
    )
    yield "scheme.surface", "Steeper or flatter surfaces were not better."
    if choice.margin is not None:
        lacks = "" if result.demand is None else f", {result.demand.needed:.3g} N m"
        times = f"{U_AMPLE:g} times" if frame.least_margin is None else f"at least {U_OVER:g} times"
        yield "scheme.bound", f"u: {times} the largest model error{lacks}, (44), (45)."
    else:
        yield "scheme.bound", "The bound follows from the arm, its drives and the mismatch above."
    yield (
        "scheme.sampled_data.horizon",
        f"{choice.horizon / frame.period:.3g} periods: found on common cases, with surface, `overshoot` and estimator.",
    )
    if frame.along:
        yield "scheme.sampled_data.estimator", "The same in all joints, as `tracking_bound` needs it."
    elif choice.drift is not None:
        drift = f"The disturbance drifts by {choice.drift * 0.8:.2g} % of the rated torque in a second"
        even = f"; the joints' drifts are evened by {choice.even:.2g} of the way." if choice.even else "."
        yield "scheme.sampled_data.estimator", drift + even
    yield "scheme.sampled_data.adaptation", "Learning is off: `tracking_bound` covers no law that learns."
    warning = f"Warns before the envelope is left: 1.25 times the share that {MANY} common cases used."
    yield "scheme.sampled_data.monitor", warning


def _relative(block: dict[str, Any], folder: Path) -> dict[str, Any]:
    block = dict(block)
    if isinstance(block.get("file"), str):
        block["file"] = relpath(block["file"], folder)
    if block.get("packages"):
        block["packages"] = [relpath(package, folder) for package in block["packages"]]
    return block
