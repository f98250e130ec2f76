"""Whether the parameters, the starts and the motion are ones that the law is made for."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax._types import Envelope, State
from slidax.controllers import SlidingMode
from slidax.diagnosis import Remedy
from slidax.robots import Articulated, Coupled
from slidax.scenarios import Scenario

from .certificate import ARM, certificate
from .each import Each
from .envelope import draws_envelope
from .extent import Extent, starts_of
from .law_of import law_of
from .members import Motion
from .numbers import listed
from .verdict import Assumption, Verdict

NAME, TITLE = "admissibility", "parameters, starts and motion are admissible"

READS = ("scheme", "trajectory", "start", "robot.nominal", "simulation")


@certificate(NAME, TITLE, covers=(*ARM, "sensor", "actuator"), reads=READS)
def admissibility(scenario: Scenario) -> Verdict:
    """The ranges of (20) and (29)-(47), `bρ(0) < e(0) < b̄ρ(0)` for each start, and the motion within the limits.

    A scenario whose parameters are out of their ranges cannot be built; what is looked at here is what they are
    together with the arm, its motion, and what is uncertain.

    - `scenario`: what is asked about.
    """
    start, inside = _start(scenario)
    assumptions = [*_parameters(scenario), *inside, *_limits(scenario), _torque(scenario)]
    failing = [one.text for one in assumptions if one.status == "fails"]
    holds = not failing
    if holds:
        statement = "All parameters are in their ranges, (20) and (29)-(47)"
        if start is not None:
            statement += f", and of the start's room in the envelope {100 * max(start.share):.3g} % is used (12)"
        statement += "."
    else:
        statement = f"Not admissible: {failing[0]}."
    found: dict[str, Any] = {} if start is None else {"start_share": start.share, "start_error": start.error}
    room = [] if start is None else [1.0 - max(start.share)]
    room += [one.value for one in assumptions if one.value is not None and one.text.startswith(("positions", "speeds"))]
    margin = min(room) if room else None
    remedies = [] if holds else _remedies(scenario, start)
    return Verdict(NAME, TITLE, holds, margin, found, tuple(assumptions), statement, tuple(remedies))


class _Start:
    """Errors at t = 0 of all starts of the set.

    - `error`: the largest size, [n], rad or m.
    - `share`: of the room towards the nearer bound, [n]; 1 is the bound.
    """

    def __init__(self, extent: Extent, reference: np.ndarray, envelope: Any) -> None:
        low, high = extent.lower - reference, extent.upper - reference
        self.error = np.maximum(np.abs(low), np.abs(high))
        # Sides are drawn by the error's sign: the wide one is always towards the start.
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
        found: Envelope | None = law.envelope(t, law.init(t, State(q=reference.q + error, dq=dq), reference))
        assert found is not None
        return found.lower, found.upper

    if not draws_envelope(scenario):
        return None, [Assumption("the scheme draws no envelope, so that any start will do", "proved")]
    reference = Motion(scenario).reference(np.zeros(1))[0][0]
    compiled, still = Each(bounds), np.zeros_like(reference)

    def envelope(error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = compiled([error], [still], [still])
        return lower[0], upper[0]

    extent = starts_of(scenario)
    start = _Start(extent, reference, envelope)
    joint = int(np.argmax(start.share))
    of = extent.said
    inside = bool(start.share[joint] < 1.0)
    if inside:
        text = f"{of} inside of the envelope, |e(0)| up to {listed(start.error)} (12)"
    else:
        text = (
            f"{extent.one} outside of the envelope: joint {joint + 1} begins up to {start.error[joint]:.4g} off its "
            f"reference, {start.share[joint]:.3g} times its bound (12)"
        )
    return start, [Assumption(text, "proved" if inside else "fails", float(start.share[joint]))]


def _parameters(scenario: Scenario) -> list[Assumption]:
    found = [Assumption("each parameter is in the range that its equation asks for, (20), (29)-(47)", "proved")]
    law = scenario.controller
    printed = law_of(scenario)
    if isinstance(law, SlidingMode) and printed is not None and getattr(printed.reaching, "gain", None) is not None:
        gain = np.asarray(printed.reaching.gain)
        if gain.ndim == 2 and np.any(gain != np.diag(np.diag(gain))):
            text = "K0 is symmetric positive definite (43); with others than a diagonal one Sig^r(s) may push s away"
            found.append(Assumption(text, "assumed"))
    return found


def _limits(scenario: Scenario) -> list[Assumption]:
    """Positions and speeds of the reference, between the samples by its own acceleration and jerk."""
    found = []
    plant = scenario.plant
    robot = getattr(plant, "own", plant).robot
    if not isinstance(robot, Articulated | Coupled):
        return [Assumption("the arm's description has no limits of position or speed to keep", "assumed")]
    limits = robot.limits
    lower, upper, fastest = (np.asarray(one) for one in (limits.lower, limits.upper, limits.velocity))
    motion = Motion(scenario)
    times = np.unique(np.append(motion.times, [0.0, scenario.t1]))
    q, dq, ddq = motion.reference(times)
    step = float(np.max(np.diff(times)))
    # Between two samples a curve leaves the chord by at most an eighth of its curvature times the step squared.
    slack = step**2 / 8.0 * np.abs(ddq).max(axis=0)
    jerk = np.abs(np.diff(ddq, axis=0) / np.diff(times)[:, None]).max(axis=0)
    span = np.where(np.isfinite(upper - lower), upper - lower, np.inf)
    with np.errstate(invalid="ignore"):
        left = np.minimum(upper - q.max(axis=0), q.min(axis=0) - lower) - slack
        room = np.where(np.isfinite(span), left / span, np.inf)
    speed = 1.0 - (np.abs(dq).max(axis=0) + step**2 / 8.0 * jerk) / fastest
    over = f"at {len(times)} times, with the most that the motion can do in between"
    for name, least in (("positions", room), ("speeds", speed)):
        joint = int(np.argmin(least))
        if not least[joint] >= 0.0:
            text = f"{name} of the motion pass a limit of joint `{robot.joint_names[joint]}`"
            found.append(Assumption(text, "fails", float(least[joint])))
        elif np.isfinite(least[joint]):
            found.append(Assumption(f"{name} of the motion are within the arm's limits, {over}", "tested",
                                    float(least[joint])))  # fmt: skip
    return found


def _torque(scenario: Scenario) -> Assumption:
    plant = scenario.plant
    own = getattr(plant, "own", plant)
    limits = getattr(own.actuator, "limits", None)
    torque = np.inf if limits is None else np.asarray(limits.torque)
    if np.isfinite(torque).all():
        return Assumption("torque limits are given for all joints; whether they do: `torque_budget`", "proved")
    return Assumption("the drives deliver any torque: a joint has no limit", "assumed")


def _remedies(scenario: Scenario, start: _Start | None) -> list[Remedy]:
    if start is None or max(start.share) < 1.0:
        return []
    path = "scheme.transformation.performance.initial"
    law = law_of(scenario)
    performance = getattr(getattr(law, "transformation", None), "performance", None)
    if performance is None:
        return []
    now = np.broadcast_to(np.asarray(performance.initial), start.share.shape)
    wanted = [float(f"{value:.3g}") for value in np.where(start.share < 1.0, now, 1.25 * start.share * now)]
    try:
        from slidax.scenarios import altered

        altered(scenario, {path: wanted})
    except DefinitionError:
        return []
    return [Remedy("an envelope that is wider at its beginning", {path: wanted})]
