"""The certificate `admissibility`: parameters, starts and motion fit the law."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.analysis.cause import Remedy
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.core.errors import DefinitionError
from slidax.core.joint_names import joint_label
from slidax.core.types import Envelope, State
from slidax.law.sliding_mode_controllers import SlidingMode
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertainty import INERTIAL_PATH

from .certificate import ARM, Assumption, Verdict, certificate, joint_values
from .sampled_scenario import BatchedFunction, SampledReference, has_envelope, surface_law
from .uncertainty_set import StartBox, start_box

NAME, TITLE = "admissibility", "parameters, starts and motion are admissible"

READS = ("scheme", "trajectory", "start", "robot.nominal", "actuator", "simulation")


@certificate(NAME, TITLE, covers=(*ARM, INERTIAL_PATH, "sensor", "actuator"), reads=READS)
def admissibility(scenario: Scenario) -> Verdict:
    """Check the parameters' ranges, that each start is inside the envelope, and the motion against the arm's limits.

    The ranges are those of the paper's (20) and (29)-(47), and the envelope is `bρ(0) < e(0) < b̄ρ(0)` (12) with the
    radius ρ, and factors b < 0 < b̄ for its two sides. A scenario cannot be built with a parameter outside its own
    range. This certificate checks the parameters together with the arm, its motion and its uncertainty.
    """
    start, inside = _start(scenario)
    assumptions = [*_parameters(scenario), *inside, *_limits(scenario), _torque(scenario)]
    failing = [line.text for line in assumptions if line.status == "fails"]
    holds = not failing
    if holds:
        statement = "All parameters are in their ranges, the paper's (20) and (29)-(47)"
        if start is not None:
            statement += f", and the start uses {100 * max(start.share):.3g} % of the envelope (12)"
        statement += "."
    else:
        statement = f"Not admissible: {failing[0]}."
    bound = {} if start is None else {"start_share": start.share, "start_error": start.error}
    margins = [] if start is None else [1.0 - max(start.share)]
    margins += [
        line.value for line in assumptions if line.value is not None and line.text.startswith(("positions", "speeds"))
    ]
    margin = min(margins) if margins else None
    remedies = [] if holds else _remedies(scenario, start)
    return Verdict(NAME, TITLE, holds, margin, bound, tuple(assumptions), statement, tuple(remedies))


class _Start:
    """Errors of all starts of the uncertainty set at t = 0.

    - `error`: largest |e|, [n], rad or m.
    - `share`: largest |e| relative to the envelope's bound on the same side, [n].
    """

    def __init__(self, extent: StartBox, reference: np.ndarray, envelope: Any) -> None:
        low, high = extent.lower - reference, extent.upper - reference
        self.error = np.maximum(np.abs(low), np.abs(high))
        # The envelope's sides depend on the sign of the start error: the wide side is the one of the start.
        upper, lower = envelope(high)[1], envelope(low)[0]
        self.share = np.maximum(
            np.where(high > 0, high / upper, 0.0),
            np.where(low < 0, low / lower, 0.0),
        )


def _start(scenario: Scenario) -> tuple[_Start | None, list[Assumption]]:
    law = scenario.controller

    def bounds(error: Any, q: Any, dq: Any) -> Any:
        t = jnp.zeros(())
        reference = scenario.trajectory.reference(t)
        envelope: Envelope | None = law.envelope(t, law.init(t, State(q=reference.q + error, dq=dq), reference))
        assert envelope is not None
        return envelope.lower, envelope.upper

    if not has_envelope(scenario):
        return None, [Assumption("the scheme has no envelope, so any start is admissible", "proved")]
    reference = SampledReference(scenario).reference(np.zeros(1))[0][0]
    compiled, still = BatchedFunction(bounds), np.zeros_like(reference)

    def envelope(error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = compiled([error], [still], [still])
        return lower[0], upper[0]

    extent = start_box(scenario)
    start = _Start(extent, reference, envelope)
    joint = int(np.argmax(start.share))
    inside = bool(start.share[joint] < 1.0)
    if inside:
        text = f"{extent.all_are} inside the envelope, |e(0)| up to {joint_values(start.error)} (12)"
    else:
        plant = scenario.plant
        robot = getattr(plant, "own", plant).robot
        text = (
            f"{extent.one_is} outside the envelope: {joint_label(robot.joint_names[joint])} begins up to "
            f"{start.error[joint]:.4g} {robot.joint_units[joint]} off its reference, {start.share[joint]:.3g} times "
            "its bound (12)"
        )
    return start, [Assumption(text, "proved" if inside else "fails", float(start.share[joint]))]


def _parameters(scenario: Scenario) -> list[Assumption]:
    assumptions = [Assumption("each parameter is in the range of the paper's equation, (20), (29)-(47)", "proved")]
    law = scenario.controller
    printed = surface_law(scenario)
    if isinstance(law, SlidingMode) and printed is not None and getattr(printed.reaching, "gain", None) is not None:
        gain = np.asarray(printed.reaching.gain)
        if gain.ndim == 2 and np.any(gain != np.diag(np.diag(gain))):
            text = "K0 is symmetric positive definite (43); since it is not diagonal, Sig^r(s) may drive s away from 0"
            assumptions.append(Assumption(text, "assumed"))
    return assumptions


def _limits(scenario: Scenario) -> list[Assumption]:
    """Return the assumptions that positions and speeds of the reference are within the arm's limits.

    Between samples, acceleration and jerk bound their change.
    """
    assumptions = []
    plant = scenario.plant
    robot = getattr(plant, "own", plant).robot
    if not isinstance(robot, Articulated | Coupled):
        return [Assumption("the arm's description has no limits of position or speed", "assumed")]
    limits = robot.limits
    lower, upper, fastest = (np.asarray(values) for values in (limits.lower, limits.upper, limits.velocity))
    motion = SampledReference(scenario)
    times = np.unique(np.append(motion.times, [0.0, scenario.t1]))
    q, dq, ddq = motion.reference(times)
    step = float(np.max(np.diff(times)))
    # Between two samples a function deviates from its chord by at most `step²/8` times its second derivative.
    deviation = step**2 / 8.0 * np.abs(ddq).max(axis=0)
    jerk = np.abs(np.diff(ddq, axis=0) / np.diff(times)[:, None]).max(axis=0)
    span = np.where(np.isfinite(upper - lower), upper - lower, np.inf)
    with np.errstate(invalid="ignore"):
        distance = np.minimum(upper - q.max(axis=0), q.min(axis=0) - lower) - deviation
        position_margin = np.where(np.isfinite(span), distance / span, np.inf)
    speed_margin = 1.0 - (np.abs(dq).max(axis=0) + step**2 / 8.0 * jerk) / fastest
    over = f"at {len(times)} times, with a bound of the motion in between"
    for name, margin in (("positions", position_margin), ("speeds", speed_margin)):
        joint = int(np.argmin(margin))
        if not margin[joint] >= 0.0:
            text = f"{name} of the motion exceed a limit of {joint_label(robot.joint_names[joint])}"
            assumptions.append(Assumption(text, "fails", float(margin[joint])))
        elif np.isfinite(margin[joint]):
            text = f"{name} of the motion are within the arm's limits, {over}"
            assumptions.append(Assumption(text, "tested", float(margin[joint])))
    return assumptions


def _torque(scenario: Scenario) -> Assumption:
    plant = scenario.plant
    own = getattr(plant, "own", plant)
    limits = getattr(own.actuator, "limits", None)
    torque = np.inf if limits is None else np.asarray(limits.torque)
    if np.isfinite(torque).all():
        return Assumption("all joints have torque limits, which `torque_budget` checks", "proved")
    return Assumption("the drives deliver any torque: a joint has no torque limit", "assumed")


def _remedies(scenario: Scenario, start: _Start | None) -> list[Remedy]:
    if start is None or max(start.share) < 1.0:
        return []
    path = "scheme.transformation.performance.initial"
    law = surface_law(scenario)
    performance = getattr(getattr(law, "transformation", None), "performance", None)
    if performance is None:
        return []
    initial = np.broadcast_to(np.asarray(performance.initial), start.share.shape)
    wider = [float(f"{value:.3g}") for value in np.where(start.share < 1.0, initial, 1.25 * start.share * initial)]
    try:
        from slidax.scenarios.load import alter

        alter(scenario, {path: wider})
    except DefinitionError:
        return []
    return [Remedy("a wider initial envelope", {path: wider})]
