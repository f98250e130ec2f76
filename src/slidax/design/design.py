"""From requirements to a law, or to the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from slidax._errors import DefinitionError
from slidax._timing import Timing
from slidax.certificates import Verdict
from slidax.certificates.extent import starts_of
from slidax.certificates.statistical import tried
from slidax.commissioning.text import WIDTH
from slidax.numerics import require_64_bits
from slidax.scenarios import ScenarioDescription
from slidax.studies.search.island import require_cmaes

from .aim import CALM, DRIVEN, OWN, Aim
from .choice import LARGEST, Choice, Frame, frame_of, template
from .proof import Asked, asked_of, boundable, of_the_rate, widened
from .refusal import Refused, of_accuracy, of_deadline, of_torque, of_torque_step, unproved
from .requirements import DesignProblem
from .search import LEAST_MARGIN, MANY, MOST, SPARE, coarse, fine, narrowest
from .trials import Trials, Worst

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


Proof = Literal["bound", "tested"]


@dataclass(frozen=True)
class Designed:
    """A law that meets the requirements.

    - `description`: the scenario with it.
    - `proof`: `bound` where `loop_rate` holds for its envelope, else `tested`: in simulated cases alone.
    - `frame`, `choice`: its numbers; `worst`: what the worst common case makes of them.
    - `demand`: on the drives and on u; None where no bound was found.
    - `rate`: verdict of `loop_rate`; None where it has no answer.
    - `check`: of random cases and a search, as the certificate `statistical`.
    - `runs`: that were simulated to find it.
    """

    description: ScenarioDescription
    proof: Proof
    frame: Frame
    choice: Choice
    worst: Worst
    demand: Asked | None
    rate: Verdict | None
    check: Verdict
    runs: int

    @property
    def spared(self) -> float:
        """Margin of the check's worst case."""
        return float(self.check.bound.get("worst_margin", np.inf))


Design = Designed | Refused
Say = Callable[[str], None]


def _unheard(_: str) -> None:
    """Nobody is told."""


def design(problem: DesignProblem, *, runs: int = RUNS, say: Say = _unheard) -> Design:
    """The law for an arm and its task, by the certificates where they have an answer, else by simulated cases.

    In closed form: ρ0 from the starts, T as required, u from `robust_torque`, H and the estimator's density in
    proportion to the period, the delay and the drives. Then fifteen pairs of H and density and three surfaces on the
    same eight cases of the set, and from the best of them a search of all these numbers, ϑ and ρ∞ at once; ρ∞ from
    `loop_rate`, or the smallest that 48 cases held. Last, random cases that were not seen before and a search for
    the worst one; where one of them left, the second search begins anew with the worst among its cases.

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
    say("what the motion and the set ask of the drives")
    request = _demand(frame, first)
    if request is not None:
        if (request.torque >= request.limit).any():
            return of_torque(problem, request)
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
        return of_deadline(trials, best)
    if requirements.torque_step is not None and best.step > requirements.torque_step:
        return of_torque_step(trials, best, requirements.torque_step)
    say("the final radius")
    sized = _sized(problem, trials, best, _aim(problem, frame))
    if isinstance(sized, Refused):
        return sized
    return _checked(problem, trials, sized, request, runs, say)


def _begin(problem: DesignProblem) -> tuple[Frame, Choice]:
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
    starts = starts_of(base.build("start"))
    frame = frame_of(
        base,
        moving,
        (np.asarray(starts.lower), np.asarray(starts.upper)),
        np.asarray(shape, float),
        period=h,
        delay=Timing(h, problem.sensor.delay, problem.actuator.dead_time).total_delay,
        has_velocity=problem.sensor.has_velocity,
    )
    if (frame.shape >= LARGEST * frame.initial).any() and requirements.accuracy != "best":
        frame = replace(frame, initial=np.maximum(frame.initial, frame.shape / LARGEST))
    frame = replace(frame, learns=requirements.proof != "bound" or boundable(len(units), learns=True))
    horizon, drift = frame.horizons[2 if len(frame.horizons) > 2 else -1], 1.0
    return frame, Choice(horizon, drift, 1.0, _provisional(frame), requirements.deadline)


def _provisional(frame: Frame) -> Any:
    """Final radii of the search, in which the steady error hardly depends on them."""
    wide = frame.radius * np.where(frame.initial > 0, frame.initial / frame.initial.max(), 1.0)
    return np.minimum(np.maximum(4.0 * wide, frame.shape if frame.shape.max() < 0.1 else 0.0), LARGEST * frame.initial)


def _demand(frame: Frame, first: Choice) -> Asked | None:
    try:
        return asked_of(frame.described(first).build("demand"))
    except DefinitionError:
        return None


def _aim(problem: DesignProblem, frame: Frame) -> Aim:
    """Return the objective of the search."""
    requirements = problem.requirements
    small = None if requirements.accuracy == "best" else float(np.min(frame.shape)) / (2.0 * SPARE)
    step = requirements.torque_step
    room = ROOM_LEFT if requirements.accuracy == "best" else LEAST_MARGIN
    most = min(DRIVEN * float(np.max(frame.changes)), np.inf if step is None else UNSEEN * step)
    return Aim(most, step is not None, small, room, OWN if requirements.proof == "bound" else np.inf)


def _best(problem: DesignProblem, frame: Frame, first: Choice) -> tuple[Trials, Worst]:
    """The best law with the better estimator, where velocities are measured."""
    aim, result = _aim(problem, frame), []
    for kalman in (True, False) if frame.has_velocity else (True,):
        trials = Trials(problem, frame, first if kalman else replace(first, drift=None))
        result.append((trials, coarse(trials, aim, kalman=kalman)))
    trials, best = min(result, key=lambda item: aim.cost(item[1]))
    return trials, fine(trials, best, aim)


def _sized(problem: DesignProblem, trials: Trials, best: Worst, aim: Aim) -> Worst | Refused:
    """The law with its final radius."""
    frame, requirements = trials.frame, problem.requirements
    if requirements.accuracy == "best":
        held = narrowest(trials, best, CALM * aim.step if aim.required else np.inf)
        result = [best] if best.holds and best.margin >= ROOM_LEFT else []
        if held is not None:
            wider = np.minimum(SPARE * held.choice.final, trials.most * frame.shape)
            result += trials.judged([replace(held.choice, final=wider)], trials.cases(MOST))
        return aim.best(result) if result else of_accuracy(trials, best, None)
    (required,) = trials.judged([replace(best.choice, final=frame.shape)], trials.cases(MANY))
    if required.holds and required.margin >= LEAST_MARGIN:
        return required
    return of_accuracy(trials, required, narrowest(trials, best))


def _checked(
    problem: DesignProblem, trials: Trials, worst: Worst, request: Asked | None, runs: int, say: Say
) -> Design:
    """The same after its certificate and its check; where a case left or came near, another law that bears it, too.

    So it is where one had a larger torque step than is required.
    """
    best, required = problem.requirements.accuracy == "best", problem.requirements.torque_step
    aim = _aim(problem, trials.frame)
    proved = boundable(trials.frame.initial.size, trials.frame.learns)
    kept: Designed | None = None
    for turn in range(TIMES):
        choice, rate = worst.choice, None
        if best and turn:
            wider = np.minimum(SLACK**turn * choice.final, LARGEST * trials.frame.initial)
            choice = replace(choice, final=np.maximum(choice.final, wider))
        # Where it holds for no radius it does not hold for a law nearby, and an answer for many joints takes a minute.
        if request is not None and proved:
            say("the certificate of the loops")
            choice, rate = _certified(problem, trials, choice)
        proved = rate is not None and bool(rate.holds)
        if problem.requirements.proof == "bound" and not proved:
            return unproved(trials, choice, rate)
        say(f"{2 * runs} cases that were not seen before")
        description = _described(trials.frame, choice, worst)
        check, hard = tried(description.build("design"), runs, seed=1 + turn)
        wild = 1.0 if required is None else check.bound.get("steady_torque_step", 0.0) / required
        if check.holds is not False and wild <= 1.0:
            result: Proof = "bound" if proved else "tested"
            built = Designed(description, result, trials.frame, choice, worst, request, rate, check, trials.runs)
            kept = built if kept is None or built.spared > kept.spared else kept
            if not best or check.holds is None or built.spared >= ENOUGH:
                return built
        if turn == TIMES - 1:
            break
        say("a law for the hardest of them, too")
        # The largest of many cases is a rare one, which a law that is half as much calmer may not show.
        trials, aim = trials.with_harder(hard), aim.stricter(float(np.sqrt(CALM / wild)) if wild > 1.0 else 1.0)
        sized = _sized(problem, trials, fine(trials, worst, aim), aim)
        if isinstance(sized, Refused):
            return kept or sized
        worst = sized
    if kept is None and required is not None and wild > 1.0:
        return of_torque_step(trials, worst, required, check)
    return kept or of_accuracy(trials, worst, None, check)


def _certified(problem: DesignProblem, trials: Trials, choice: Choice) -> tuple[Choice, Verdict | None]:
    """A law and what `loop_rate` says of it, with the final radius that this asks for, where any may be had."""

    def rate_of(choice: Choice) -> Verdict | None:
        return of_the_rate(trials.frame.described(choice).build("design"))

    rate = rate_of(choice)
    if problem.requirements.accuracy != "best":
        return choice, rate
    # An envelope that is wider, and not certified either, is good for nothing.
    return widened(choice, rate, rate_of, LARGEST * trials.frame.initial) or (choice, rate)


def _described(frame: Frame, choice: Choice, worst: Worst) -> ScenarioDescription:
    """The scenario of a choice; its monitor is as strict as the common cases allow."""
    used = float(np.clip(1.25 * (1.0 - worst.promise), 0.3, 1.0))
    return frame.described(choice, float(f"{used:.2g}"))
