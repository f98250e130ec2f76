"""Design a law from requirements, or refuse with a reason; write the law as a scenario file with comments."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
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
from .speed_table import SpeedRow, random_motions, speed_table
from .trials import CALM, DRIVE_SHARE, OWN_DRIVE_SHARE, Objective, Trials, WorstCase

RUNS = 1000
"""Number of random cases in each check. The search for the worst case then simulates as many cases again."""

TIMES, SLACK = 4, 1.5
"""Number of checks, each with new cases, before the design is refused; and the factor by which each failed check widens
the final radius, if no accuracy is required."""

ENOUGH = 0.1
"""Margin of the worst case, as a share of the envelope's width, that ends the checks early. It is not 0, since a longer
search finds worse cases."""

U_OVER, U_AMPLE = 1.15, 2.0
"""Size u of the robust torque, as a multiple of the largest model error: its lower limit if u is searched, else its
value, unless the arm's default bound is larger."""

UNSEEN = 0.95
"""Share of the required torque step that is allowed in the common cases: the check has more cases, so a larger step."""

ROOM_LEFT = 0.12
"""Least margin in the common cases, as a share of the envelope's width, if the envelope is not widened by `SPARE`."""

NEAR = 0.05
"""Initial radius of the envelope for `tracking_bound` [rad or m]; a much wider envelope makes the loop too soft."""

Proof = Literal["bound", "tested"]


@dataclass(frozen=True)
class DesignResult:
    """A law that meets the requirements.

    - `description`: the scenario with the law.
    - `proof`: `bound` if `tracking_bound` certifies the law inside its envelope; `tested` if it was only simulated.
    - `space`, `choice`: common and searched values of the law.
    - `worst`: worst values of the law over the common cases, which are simulated with all laws.
    - `demand`: torques that motion and uncertainty require of the drives and of the robust torque; None if they have no
      bound.
    - `bound`: verdict of the certificate `tracking_bound`; None if no bound is required.
    - `check`: verdict of the certificate `statistical`, from new random cases and a search for the worst case.
    - `runs`: number of runs in the search with the chosen estimator, without the runs of `check`.
    - `speeds`: certified error against the speed of other motions, if a bound is required in a workspace.
    """

    description: ScenarioDescription
    proof: Proof
    space: DesignSpace
    choice: DesignPoint
    worst: WorstCase
    demand: DriveDemand | None
    bound: Verdict | None
    check: Verdict
    runs: int
    speeds: tuple[SpeedRow, ...] = ()

    @property
    def spared(self) -> float:
        """Least distance from the error to the envelope in the check, over the envelope's width; inf if unknown."""
        return float(self.check.bound.get("worst_margin", np.inf))


Design = DesignResult | Refusal
Say = Callable[[str], None]


def _ignore(_: str) -> None:
    """Ignore the progress."""


def design(problem: DesignProblem, *, runs: int = RUNS, say: Say = _ignore) -> Design:
    """Design a law for an arm and its task; return the result, or a refusal with the reason.

    1. In closed form: the envelope's initial radius ρ0 from the initial states, its deadline T as required, the size u
       of the robust torque from `robust_torque`, and the grid of step 2 from the period, the delay and the drives.
    2. A grid of the planning horizon H and the estimator's density, simulated on eight cases of the uncertainty set.
       Three slopes of the sliding surface are simulated for the best law of the grid.
    3. CMA-ES over all these values and the overshoot ϑ, from the best law of step 2. The final radius ρ∞ is the
       required accuracy; for `best` it is searched, too.
    4. For `best`, ρ∞ from the smallest one that holds in 48 cases; a required accuracy must hold in 48 cases. If a
       bound is required, `tracking_bound` must certify ρ∞.
    5. A check by new random cases and a search for the worst case. If a case leaves the envelope, comes too near its
       edge or exceeds the required torque step, steps 3 and 4 are repeated with the worst cases added.
    6. In a workspace, if a bound is required, `tracking_bound` along other motions at several speeds.

    If a bound is required, `law_with_bound` first chooses the law from which the steps begin.

    - `problem`: from `read_problem`.
    - `runs`: number of random cases in each check.
    - `say`: function that is called with the name of each step, for the progress.

    Raises DefinitionError if the requirements contradict each other, the package `cmaes` is missing, or JAX computes
    with 32-bit numbers.
    """
    # Fail at once: the check, which needs the package, begins only after minutes.
    require_cmaes()
    require_64_bits()
    space, first = _begin(problem)
    if space.along:
        say("search for laws with a bound along the motion")
        first, verdict = law_with_bound(space, first)
        if not verdict.holds:
            return proof_refusal(problem, space, first, verdict)
    say("demand of motion and uncertainty on the drives")
    demand = _demand(space, first)
    if demand is not None:
        if (demand.torque >= demand.limit).any():
            return torque_refusal(problem, demand)
        least, ample = (float(f"{demand.needed * times:.4g}") for times in (U_OVER, U_AMPLE))
        if problem.requirements.torque_step is not None:
            # The search may raise u: on the two-link arm, three times as much gives smaller steps and errors.
            space, first = replace(space, least_margin=least), replace(first, margin=max(demand.u, least))
        elif ample > demand.u:
            first = replace(first, margin=ample)
    say("search for horizon, estimator and surface")
    trials, best = _best_estimator(problem, space, first)
    requirements = problem.requirements
    if not best.holds:
        return deadline_refusal(trials, best)
    if requirements.torque_step is not None and best.step > requirements.torque_step:
        return torque_step_refusal(trials, best, requirements.torque_step)
    say("search for the final radius")
    sized = _with_final_radius(problem, trials, best, _aim(problem, space))
    if isinstance(sized, Refusal):
        return sized
    return _with_speeds(problem, _check(problem, trials, sized, demand, runs, say), say)


def _with_speeds(problem: DesignProblem, result: Design, say: Say) -> Design:
    """Return the result with a speed table if its law has a bound and the task is a workspace; otherwise unchanged."""
    if isinstance(result, Refusal) or result.bound is None or problem.workspace is None:
        return result
    say("bound along other motions in the workspace")
    motions = random_motions(problem.workspace, problem.robot.build())
    return replace(result, speeds=tuple(speed_table(result.description, motions, result.choice.final)))


def _begin(problem: DesignProblem) -> tuple[DesignSpace, DesignPoint]:
    """Return the space of all designs, and the first point of the search."""
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
    space = design_space(
        base,
        moving,
        (np.asarray(starts.lower), np.asarray(starts.upper)),
        np.asarray(shape, float),
        period=h,
        delay=Timing(h, problem.sensor.delay, problem.actuator.dead_time).total_delay,
        has_velocity=problem.sensor.has_velocity,
    )
    if requirements.proof == "bound":
        space = replace(space, along=True, initial=np.full(space.initial.shape, NEAR))
    if (space.shape >= LARGEST * space.initial).any() and requirements.accuracy != "best":
        space = replace(space, initial=np.maximum(space.initial, space.shape / LARGEST))
    horizon, drift = space.horizons[2 if len(space.horizons) > 2 else -1], 1.0
    return space, DesignPoint(horizon, drift, 1.0, _provisional(space), requirements.deadline)


def law_with_bound(space: DesignSpace, first: DesignPoint) -> tuple[DesignPoint, Verdict]:
    """Return the law with the smallest error bound by `tracking_bound` on a grid, and its verdict.

    The grid is over the planning horizon H and the estimator's density. If no verdict holds, return the law with the
    fewest failing assumptions, and of these the law with the longest H. For each density the search begins at the
    longest H, and ends at the first law that fails after a certified law, since torque steps usually grow as H gets
    shorter. A certified law with a still shorter H would be missed.

    - `space`: values that are common to all laws.
    - `first`: the other values of all laws.
    """
    results: list[tuple[int, float, int]] = []
    laws: list[tuple[DesignPoint, Verdict]] = []
    for drift in DRIFTS:
        held = False
        for horizon in sorted(space.horizons, reverse=True):
            law = replace(first, horizon=horizon, drift=drift, final=LARGEST * space.initial)
            verdict = tracking_verdict(space.described(law))
            if held and not verdict.holds:
                break
            held = verdict.holds is True
            failing = 0 if held else 1 + sum(line.status == "fails" for line in verdict.assumptions)
            error = float(np.max(verdict.bound["error"])) if held else -horizon
            results.append((failing, error, len(results)))
            laws.append((replace(law, final=first.final), verdict))
    return laws[min(results)[2]]


def _provisional(space: DesignSpace) -> Any:
    """Return final radii for the first searches, so wide that the steady error hardly depends on them."""
    wide = space.radius * np.where(space.initial > 0, space.initial / space.initial.max(), 1.0)
    return np.minimum(np.maximum(4.0 * wide, space.shape if space.shape.max() < 0.1 else 0.0), LARGEST * space.initial)


def _demand(space: DesignSpace, first: DesignPoint) -> DriveDemand | None:
    try:
        return drive_demand(space.described(first).build("demand"))
    except DefinitionError:
        return None


def _aim(problem: DesignProblem, space: DesignSpace) -> Objective:
    """Return the objective of the search: the requirements, with a reserve for cases that the search does not see."""
    requirements = problem.requirements
    small = None if requirements.accuracy == "best" else float(np.min(space.shape)) / (2.0 * SPARE)
    step = requirements.torque_step
    room = ROOM_LEFT if requirements.accuracy == "best" else LEAST_MARGIN
    most = min(DRIVE_SHARE * float(np.max(space.changes)), np.inf if step is None else UNSEEN * step)
    return Objective(most, step is not None, small, room, OWN_DRIVE_SHARE if requirements.proof == "bound" else np.inf)


def _best_estimator(problem: DesignProblem, space: DesignSpace, first: DesignPoint) -> tuple[Trials, WorstCase]:
    """Return the trials and the best law; if velocities are measured, with the better of the two estimators."""
    aim, result = _aim(problem, space), []
    for kalman in (True, False) if space.has_velocity else (True,):
        trials = Trials(problem, space, first if kalman else replace(first, drift=None))
        result.append((trials, coarse_search(trials, aim, kalman=kalman)))
    trials, best = min(result, key=lambda item: aim.cost(item[1]))
    return trials, fine_search(trials, best, aim)


def _with_final_radius(problem: DesignProblem, trials: Trials, best: WorstCase, aim: Objective) -> WorstCase | Refusal:
    """Return the law with its final radius, or a refusal."""
    space, requirements = trials.space, problem.requirements
    if requirements.accuracy == "best":
        held = narrowest_envelope(trials, best, CALM * aim.step if aim.required else np.inf)
        result = [best] if best.holds and best.margin >= ROOM_LEFT else []
        if held is not None:
            wider = np.minimum(SPARE * held.choice.final, trials.most * space.shape)
            result += trials.evaluate([replace(held.choice, final=wider)], trials.cases(MOST))
        return aim.best(result) if result else accuracy_refusal(trials, best, None)
    (required,) = trials.evaluate([replace(best.choice, final=space.shape)], trials.cases(MANY))
    if required.holds and required.margin >= LEAST_MARGIN:
        return required
    return accuracy_refusal(trials, required, narrowest_envelope(trials, best))


def _check(
    problem: DesignProblem, trials: Trials, worst: WorstCase, demand: DriveDemand | None, runs: int, say: Say
) -> Design:
    """Certify and check a law; if it fails, repeat the search with the hardest cases, and check up to `TIMES` laws.

    A law fails its check if a case leaves the envelope, or comes near its edge, or exceeds the required torque step.
    Return the law that passed; else the law with the largest margin among those that held, or a refusal.
    """
    best, required = problem.requirements.accuracy == "best", problem.requirements.torque_step
    aim = _aim(problem, trials.space)
    kept: DesignResult | None = None
    for turn in range(TIMES):
        choice: DesignPoint = worst.choice
        bound: Verdict | None = None
        if best and turn:
            wider = np.minimum(SLACK**turn * choice.final, LARGEST * trials.space.initial)
            choice = replace(choice, final=np.maximum(choice.final, wider))
        if trials.space.along:
            say("bound along the motion")
            choice, bound = _certify(trials.space, choice, best)
            if not bound.holds:
                # The search minimises simulated errors, and may have ended at a law without a bound.
                choice, bound = _certify(trials.space, replace(trials.first, final=choice.final), best)
                (worst,) = trials.evaluate([choice], trials.cases(MOST))
            if not bound.holds:
                return proof_refusal(problem, trials.space, choice, bound)
        say(f"check by {2 * runs} new cases")
        description = _description(trials.space, choice, worst)
        check, hard = statistical_with_cases(description.build("design"), runs, seed=1 + turn)
        wild = 1.0 if required is None else check.bound.get("steady_torque_step", 0.0) / required
        if check.holds is not False and wild <= 1.0:
            proof: Proof = "tested" if bound is None else "bound"
            built = DesignResult(description, proof, trials.space, choice, worst, demand, bound, check, trials.runs)
            kept = built if kept is None or built.spared > kept.spared else kept
            if not best or check.holds is None or built.spared >= ENOUGH:
                return built
        if turn == TIMES - 1:
            break
        say("search with the hardest cases added")
        # The largest step of many cases is rare: half of the necessary reduction may be enough.
        trials, aim = trials.with_harder(hard), aim.stricter(float(np.sqrt(CALM / wild)) if wild > 1.0 else 1.0)
        sized = _with_final_radius(problem, trials, fine_search(trials, worst, aim), aim)
        if isinstance(sized, Refusal):
            return kept or sized
        worst = sized
    if kept is None and required is not None and wild > 1.0:
        return torque_step_refusal(trials, worst, required, check)
    return kept or accuracy_refusal(trials, worst, None, check)


def _certify(space: DesignSpace, choice: DesignPoint, best: bool) -> tuple[DesignPoint, Verdict]:
    """Return a law and its verdict of `tracking_bound`; if `best`, with the smallest certified final radius."""

    def verdict_of(law: DesignPoint) -> Verdict:
        return tracking_verdict(space.described(law))

    wider = certified_radii(choice, verdict_of, LARGEST * space.initial) if best else None
    return wider or (choice, verdict_of(choice))


def _description(space: DesignSpace, choice: DesignPoint, worst: WorstCase) -> ScenarioDescription:
    """Return the scenario of a design, with a monitor as strict as the common cases allow."""
    used = float(np.clip(1.25 * (1.0 - worst.guarantee_margin), 0.3, 1.0))
    return space.described(choice, float(f"{used:.2g}"))


CERTIFICATE = ".certificate.json"
"""Ending of the certificate file, after the scenario's own name."""


def design_text(result: DesignResult, folder: Path) -> str:
    """Return the scenario as YAML with comments, ready for `slidax run`.

    - `folder`: folder of the file. Paths in the file are relative to it.
    """
    values = result.description.model_dump(mode="json", exclude_unset=True)
    for name in ("robot", "trajectory"):
        values[name] = _relative(values[name], folder)
    return dump_commented(values, _comments(result))


def write_design(result: DesignResult, out: Path, certificates: Certificates) -> Path:
    """Write the scenario to the YAML file `out`, and its certificates next to it; return the certificates' path."""
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, design_text(result, out.parent))
    path = out.with_name(out.stem + CERTIFICATE)
    content = certificates.as_json() | ({"speeds": [row.as_json() for row in result.speeds]} if result.speeds else {})
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    write_text(path, text + "\n")
    return path


def name_proof(verdict: Verdict | None) -> str:
    """Return the proof of a design in words, for a verdict that holds: certified if all of its lines are proved.

    - `verdict`: of `tracking_bound`; None for a design that was only simulated.
    """
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
        return f"{text} Nothing is uncertain, so one run covers all cases."
    return (
        f"{text} All of {check['runs']} random cases and {check['searched']} cases of a search for the worst one stay "
        f"inside; the smallest margin is {check['worst_margin']:.2g} of the envelope's width."
    )


def _comments(result: DesignResult) -> Iterator[tuple[str, str]]:
    """Yield the path of each commented key, and its comment."""
    space, choice = result.space, result.choice
    yield "robot", _proof(result)
    yield (
        "scheme.transformation.performance",
        f"The error is within `final` from the deadline on. In the worst of {result.worst.cases} common cases the "
        f"steady error is {result.worst.error:.2g}. `initial` exceeds the error of every initial state.",
    )
    yield "scheme.surface", "Steeper and flatter surfaces were tried and were worse."
    if choice.margin is not None:
        lacks = "" if result.demand is None else f", {result.demand.needed:.3g} N m"
        times = f"{U_AMPLE:g} times" if space.least_margin is None else f"at least {U_OVER:g} times"
        yield (
            "scheme.bound",
            f"Size u of the robust torque: {times} the largest model error{lacks}, as in the paper's eqs. (44), (45).",
        )
    else:
        yield "scheme.bound", "The bound follows from the arm, its drives and the mismatch above."
    yield (
        "scheme.sampled_data.horizon",
        f"{choice.horizon / space.period:.3g} periods, from a search together with surface, `overshoot` and estimator.",
    )
    if space.along:
        yield "scheme.sampled_data.estimator", "Equal in all joints, as `tracking_bound` requires."
    elif choice.drift is not None:
        drift = f"The disturbance drifts by {choice.drift * 0.8:.2g} % of the rated torque in a second"
        even = (
            f"; the rated torque is averaged with the mean of all joints, weight {choice.even:.2g}."
            if choice.even
            else "."
        )
        yield "scheme.sampled_data.estimator", drift + even
    yield "scheme.sampled_data.adaptation", "Learning is off: `tracking_bound` covers no law that learns."
    warning = (
        "Warns before the envelope is left: at 1.25 times the share of it that the error used in the common cases."
    )
    yield "scheme.sampled_data.monitor", warning


def _relative(block: dict[str, Any], folder: Path) -> dict[str, Any]:
    block = dict(block)
    if isinstance(block.get("file"), str):
        block["file"] = relpath(block["file"], folder)
    if block.get("packages"):
        block["packages"] = [relpath(package, folder) for package in block["packages"]]
    return block
