"""Admission of motions: decide if a certified law tracks a motion within its bound, or how much slower it must be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.motions.trajectory import AbstractMotion, AbstractPiecewisePolynomial
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertainty import INERTIAL_PATH

from ..certificate import Assumption, Verdict, certificate
from .certified_law import CertifiedLaw
from .drive_limits import DriveBounds, drive_bounds
from .law_limits import law_lines, plan_lines
from .parameter_sets import INERTIAL
from .path_cells import AbstractPieces, pieces_of
from .tracking_bound import NAME, TITLE, WIDEST, CertifiedPath, certified_path, verdict_of

Floats = NDArray[np.float64]

COVERED = (
    INERTIAL_PATH,
    *INERTIAL,
    "robot.plant.coulomb",
    "robot.plant.viscous",
    "disturbance",
    "start",
    "tolerance",
)
"""Paths of an uncertainty set that the bound covers."""

SLOW_DOWNS = (1.1, 1.25, 1.41, 1.6, 1.8, 2.0, 2.5, 3.0, 4.0)
"""Factors on a motion's duration in the search for a slow-down."""

LATE = 1e9
"""s: time at which every tolerance band has its final width."""

HALVINGS = 3
"""Bisection steps below the first factor with which the motion is admitted."""


@dataclass(frozen=True)
class MotionLimit:
    """A limit that a motion may exceed, at the joint and time of the largest excess.

    - `joint`: name of the joint. `time`: s.
    - `what`: `error`, `position`, `speed`, `torque`, `torque step` or `planned torque step`.
    - `value`, `allowed`: the bound and its limit, in SI units; the value is None if no bound exists.
    """

    joint: str
    time: float
    what: str
    value: float | None
    allowed: float

    def as_json(self) -> dict[str, Any]:
        """Return the limit as `slidax admit --json` prints it."""
        return {name: getattr(self, name) for name in ("joint", "time", "what", "value", "allowed")}

    def __str__(self) -> str:
        value = "has no bound" if self.value is None else f"{self.value:.3g}"
        return f"{self.what} of `{self.joint}` at {self.time:.3g} s: {value}, allowed {self.allowed:.3g}"


@dataclass(frozen=True, eq=False)
class MotionVerdict:
    """The error bound along one motion, and the limits that the motion may exceed.

    - `verdict`: the bound with its assumptions. It holds if the error is at most the allowed error, the arm's ranges
      are kept, no torque limit acts, the motion itself needs no larger torque step than the drives have, and the
      assumptions of `plan_lines` hold.
    - `limits`: limits that the motion may exceed: error, positions, speeds, then drives. A limit on the torque step
      alone does not change the verdict.
    """

    verdict: Verdict
    limits: tuple[MotionLimit, ...]

    @property
    def step_proved(self) -> bool:
        """True if it is proved that no torque rate limit acts."""
        return all(limit.what != "torque step" for limit in self.limits)


@dataclass(frozen=True, eq=False)
class MotionAdmission:
    """The decision for one motion.

    - `name`: name of the motion, such as its file.
    - `admitted`: True if the guarantee holds for the motion as it is.
    - `bound`: error bound of each joint [n], rad or m; None if no bound exists.
    - `dominant`: the term with the largest share of the bound; empty if no bound exists.
    - `slow_down`: smallest factor on the motion's duration with which it is admitted, as far as the search tells; 1 if
      `admitted`, None if no factor was found or searched.
    - `limit`: the first limit that the motion may exceed; None if there is none, or the motion is admitted.
    - `verdict`: the verdict for the motion as it is.
    """

    name: str
    admitted: bool
    bound: Floats | None
    dominant: str
    slow_down: float | None
    limit: MotionLimit | None
    verdict: Verdict = field(repr=False)

    def as_json(self) -> dict[str, Any]:
        """Return the decision as `slidax admit --json` prints it."""
        return {
            "file": self.name,
            "admitted": self.admitted,
            "grade": self.verdict.grade,
            "bound": None if self.bound is None else self.bound.tolist(),
            "dominant": self.dominant,
            "slow_down": self.slow_down,
            "limit": None if self.limit is None else self.limit.as_json(),
        }


@certificate(NAME, TITLE, covers=COVERED)
def tracking_bound(scenario: Scenario) -> Verdict:
    """Bound the tracking error along the scenario's motion, for its whole uncertainty set (docs/any-motion.md).

    - `scenario`: a scenario with computed torque or a sliding-mode law in sampled-data form, and the same loop in all
      joints. Its motion consists of polynomials, a sinusoid or exponentials.
    """
    try:
        law = certified_law(scenario)
        pieces_of(scenario.trajectory, scenario.t1)
    except DefinitionError as error:
        return Verdict(NAME, TITLE, None, None, {}, (), f"not applicable: {error}")
    return judge_motion(law, scenario.trajectory, allowed_error(scenario), scenario.t1).verdict


@lru_cache(maxsize=4)
def certified_law(scenario: Scenario) -> CertifiedLaw:
    """Return the scenario's law with its arm and uncertainty, by `CertifiedLaw.of`; cached."""
    return CertifiedLaw.of(scenario)


def piecewise(motion: AbstractMotion) -> AbstractPiecewisePolynomial:
    """Return the motion as a piecewise polynomial, which can be slowed down.

    Raises DefinitionError for another motion.
    """
    if not isinstance(motion, AbstractPiecewisePolynomial):
        raise DefinitionError(f"the motion must consist of polynomials and end at rest; got `{type(motion).__name__}`")
    return motion


def allowed_error(scenario: Scenario) -> Floats | None:
    """Return the narrower side of the scenario's final tolerance band [n], rad or m; None without a band."""
    if scenario.tolerance is None:
        return None
    still, late = jnp.zeros(scenario.controller.joints), jnp.asarray(LATE)
    envelope = scenario.tolerance.envelope(late, scenario.tolerance.init(jnp.zeros(()), still))
    assert envelope is not None
    return np.minimum(-np.asarray(envelope.lower, float), np.asarray(envelope.upper, float))


def admit(
    law: CertifiedLaw,
    motion: AbstractPiecewisePolynomial,
    name: str = "motion",
    *,
    allowed: Any = None,
    assume_steps: bool = False,
    slow_down: bool = True,
) -> MotionAdmission:
    """Decide if a law's guarantee holds for a motion, and if not, how much slower the motion must be.

    - `allowed`: largest allowed error, a scalar or [n], rad or m; None to admit any motion that has an error bound.
    - `assume_steps`: True to assume that the torque rate limit does not act where that is not proved. A motion that
      itself needs larger torque steps is still not admitted.
    - `slow_down`: True to search for the smallest factor on the motion's duration with which it is admitted.
    """

    def judged(factor: float) -> MotionVerdict:
        return judge_motion(law, slowed(motion, factor), allowed)

    def holds(answer: MotionVerdict) -> bool:
        return answer.verdict.holds is True and (assume_steps or answer.step_proved)

    answer = judged(1.0)
    admitted = holds(answer)
    factor: float | None = 1.0 if admitted else None
    if not admitted and slow_down:
        last = 1.0
        for candidate in SLOW_DOWNS:
            if holds(judged(candidate)):
                factor = candidate
                break
            last = candidate
        for _ in range(HALVINGS if factor is not None else 0):
            assert factor is not None
            middle = round(0.5 * (last + factor), 3)
            last, factor = (last, middle) if holds(judged(middle)) else (middle, factor)
    bound = answer.verdict.bound
    terms = bound.get("terms", {})
    return MotionAdmission(
        name=name,
        admitted=admitted,
        bound=np.asarray(bound["error"]) if "error" in bound else None,
        dominant=max(terms, key=lambda term: terms[term]) if terms else "",
        slow_down=factor,
        limit=None if admitted or not answer.limits else answer.limits[0],
        verdict=answer.verdict,
    )


def monitor_setting(admissions: Sequence[MotionAdmission]) -> dict[str, list[float]] | None:
    """Return the setting `disturbance` of the law's run-time monitor (`Monitor`); None if no motion is admitted.

    The monitor warns if a joint's estimated disturbance exceeds this setting [n], rad/s² or m/s². For every arm of the
    set the setting bounds the estimate along the admitted motions, so that no false alarm occurs.
    """
    bounds = [answer.verdict.bound["disturbance"] for answer in admissions if answer.admitted]
    if not bounds:
        return None
    largest = np.max(bounds, axis=0)
    # Rounded up to four digits.
    unit = 10.0 ** (np.floor(np.log10(np.maximum(largest, 1e-9))) - 3.0)
    return {"disturbance": [float(f"{value:.6g}") for value in np.ceil(largest / unit) * unit]}


def slowed(motion: AbstractPiecewisePolynomial, factor: float) -> AbstractPiecewisePolynomial:
    """Return the motion with all times multiplied by a factor."""
    if factor == 1.0:
        return motion
    powers = np.arange(len(motion.coefficients) - 1, -1, -1.0)
    return eqx.tree_at(
        lambda changed: (changed.times, changed.coefficients),
        motion,
        (motion.times * factor, motion.coefficients / (factor**powers)[:, None, None]),
    )


def judge_motion(
    law: CertifiedLaw, motion: AbstractMotion, allowed: Any = None, until: float | None = None
) -> MotionVerdict:
    """Return the bound along a motion with its assumptions, and the limits that the motion may exceed.

    - `allowed`: largest allowed error, a scalar or [n], rad or m; None if any error bound will do.
    - `until`: time up to which a motion without an end is bounded [s].
    """
    certified = certified_path(
        law.arm, motion, law.loop, law.uncertainty, bodies=law.bodies, hand_over=law.hand_over, until=until
    )
    limits = _passed_ranges(law, certified.path.cells.pieces)
    verdict = verdict_of(certified, law.arm, allowed, law.premises)
    if verdict.holds is False:
        limits.insert(0, _error_limit(law, certified, allowed))
    if not certified.bounds.verified:
        return MotionVerdict(verdict, tuple(limits))
    drives = drive_bounds(law.arm, certified.solution)
    lines, passed = _drive_lines(law, certified, drives)
    limits += passed
    failing = [f"{limit}" for limit in limits if limit.what != "torque step"]
    planned = plan_lines(law, certified)
    failing += [line.text for line in planned if line.status == "fails"]
    texts = [
        Assumption(f"the motion keeps the arm's range: {limit}", "fails")
        for limit in limits
        if limit.what in ("position", "speed")
    ]
    statement = verdict.statement if not failing or verdict.holds is False else f"Not certified: {failing[0]}."
    answer = Verdict(
        NAME,
        TITLE,
        not failing,
        verdict.margin,
        {
            **verdict.bound,
            "torque": drives.torque.max(axis=0),
            "torque_step": drives.step.max(axis=0),
            "disturbance": certified.bounds.outputs["estimate"].max(axis=0),
        },
        (*verdict.assumptions, *law_lines(law, certified), *planned, *lines, *texts),
        statement,
    )
    return MotionVerdict(answer, tuple(limits))


def _error_limit(law: CertifiedLaw, certified: CertifiedPath, allowed: Any) -> MotionLimit:
    """Return the limit on the error, where the error exceeds it most or has no bound."""
    bounds = certified.bounds
    limit = np.broadcast_to(np.asarray(np.inf if allowed is None else allowed, float), law.arm.joints)
    share = bounds.error if allowed is None else bounds.error / limit
    cell, joint = (int(i) for i in np.unravel_index(int(np.argmax(share)), share.shape))
    value = float(bounds.error[cell, joint]) if bounds.verified else None
    largest = float(limit[joint]) if allowed is not None else WIDEST
    return MotionLimit(law.arm.joint_names[joint], float(certified.path.cells.centres[cell]), "error", value, largest)


def _passed_ranges(law: CertifiedLaw, motion: AbstractPieces) -> list[MotionLimit]:
    """Return the motion's positions and speeds beyond the arm's own limits."""
    limits, passed = law.arm.limits, []
    for order, what, low, high in (
        (0, "position", limits.lower, limits.upper),
        (1, "speed", -limits.velocity, limits.velocity),
    ):
        reached = motion.extremes(order)
        for value, at, allowed, over in (
            (reached.largest, reached.when_largest, high, 1.0),
            (reached.least, reached.when_least, low, -1.0),
        ):
            beyond = over * (value - np.broadcast_to(np.asarray(allowed, float), value.shape))
            joint = int(np.argmax(beyond))
            if beyond[joint] > 1e-9:
                bound = float(np.broadcast_to(np.asarray(allowed, float), value.shape)[joint])
                passed.append(
                    MotionLimit(law.arm.joint_names[joint], float(at[joint]), what, float(value[joint]), bound)
                )
    return passed


def _drive_lines(
    law: CertifiedLaw, certified: CertifiedPath, drives: DriveBounds
) -> tuple[list[Assumption], list[MotionLimit]]:
    """Return the assumptions about the drives' limits, and the limits that may act.

    If the motion itself needs too large a torque step, the assumption fails: even the nominal arm needs that step.
    """
    lines, passed = [], []
    allowed = np.broadcast_to(law.loop.period * law.torque_rate, drives.planned_step.shape)
    needed = drives.planned_step / allowed
    cell, joint = (int(i) for i in np.unravel_index(int(np.argmax(needed)), needed.shape))
    possible = bool(needed[cell, joint] <= 1.0)
    if not possible:
        name, time = law.arm.joint_names[joint], float(certified.path.cells.centres[cell])
        planned, most = float(drives.planned_step[cell, joint]), float(allowed[cell, joint])
        text = (
            f"the motion needs no larger torque step than the drives have: `{name}` needs {planned:.3g} of {most:.3g} "
            f"{law.arm.torque_units[joint]} at {time:.3g} s"
        )
        lines.append(Assumption(text, "fails", planned))
        passed.append(MotionLimit(name, time, "planned torque step", planned, most))
    for what, value, plan, limit in (
        ("torque", drives.torque, drives.planned_torque, law.torque),
        ("torque step", drives.step, drives.planned_step, law.loop.period * law.torque_rate),
    ):
        if not np.isfinite(limit).any():
            continue
        share = value / limit
        cell, joint = (int(i) for i in np.unravel_index(int(np.argmax(share)), share.shape))
        unit, name = law.arm.torque_units[joint], law.arm.joint_names[joint]
        time = float(certified.path.cells.centres[cell])
        text = (
            f"no limit of the {'torque' if what == 'torque' else 'torque rate'} acts: the {what} is at most "
            f"{value[cell, joint]:.3g} of {limit[joint]:.3g} {unit} in `{name}` at {time:.3g} s, of which the motion "
            f"itself needs {plan[cell, joint]:.3g} {unit}"
        )
        if share[cell, joint] <= 1.0:
            lines.append(Assumption(text, "proved", float(value[cell, joint])))
            continue
        assumed = what == "torque step" and possible
        lines.append(Assumption(text, "assumed" if assumed else "fails", float(value[cell, joint])))
        passed.append(MotionLimit(name, time, what, float(value[cell, joint]), float(limit[joint])))
    # The torque comes before the torque step, as in the C code.
    passed.sort(key=lambda limit: limit.what != "torque")
    return lines, passed
