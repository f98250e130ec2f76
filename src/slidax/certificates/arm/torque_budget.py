"""The certificate `torque_budget`: the drives deliver the torque of motion and approach for every member of the set."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax._errors import DefinitionError, counted
from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.scenarios.load import altered
from slidax.simulation import Plant

from ..certificate import ARM, certificate
from ..demand import Demand
from ..each import Flags, Floats
from ..verdict import Assumption, Verdict
from .approach import Approach, approach_of
from .braking import room_to_brake
from .demand import compute_demand
from .members import Members
from .motion import Belief, Motion

TORQUE_BUDGET = "torque_budget", "the drives deliver the torque"

FREE = 0.1
"""Share of the simulated approach, its last part, in which no limit may be reached."""

LONGER = (1.5, 2.0, 3.0, 4.0)
"""Factors of the deadline, in the search for one with which no limit is reached."""


@certificate(*TORQUE_BUDGET, covers=ARM)
def torque_budget(scenario: Scenario, demand: Demand | None = None, family: Family | None = None) -> Verdict:
    """Check torque and torque rate of every member against the limits of the drives.

    Along the motion they are computed: `τ = M̂ (q̈_r - w*) + n̂` of each member. On the approach from the start to the
    reference they are simulated, for members and starts at ends of the set. If a limit is reached only on the approach,
    the certificate holds with `since`, the time from which no limit is reached: the other certificates apply from then
    on.

    - `demand`: of the scenario's set; computed by default.
    - `family`: another set, such as a study's; `demand` must belong to it.
    """
    members = Members.of(scenario, family)
    n = members.plant.robot.joints
    limit, rate = limits_of(scenario, n)
    if not np.isfinite(limit).any() and not np.isfinite(rate).any():
        text = "the drives have no limits: set `actuator.torque`, `actuator.rate`"
        return Verdict(*TORQUE_BUDGET, None, None, {}, (), text)
    demand = compute_demand(scenario, family) if demand is None else demand
    torque, step = along_the_motion(scenario, demand, members)
    change = rate * scenario.period
    approach = approach_of(members)
    used = np.maximum(torque / limit, step / change)
    reached = approach.reached(limit, change)
    steady = float(used.max())
    free_after = approach.free_after(limit, change)
    since = float(np.max(free_after)) if reached.any() else None
    free = approach.ended and (since is None or since <= (1.0 - FREE) * approach.until)
    holds = bool(steady < 1.0 and free)
    rest = approach if since is None or not free else approach.after(since)
    share = max(steady, float(np.max(rest.peak / limit)), float(np.max(rest.step / change)))
    # A limit that is reached leaves no margin: the share is 1 up to rounding.
    margin = 1.0 - share if free or steady >= 1.0 else None
    braking = room_to_brake(scenario, members, limit, torque)
    bound: dict[str, Any] = {
        "torque": torque,
        "torque_step": step,
        "approach_torque": approach.peak,
        "approach_torque_step": approach.step,
        "free_after": free_after,
        "acceleration_left": braking.acceleration,
        "recovery_room": braking.room(approach.error, approach.error_rate),
        "braking_speed": braking.speed(scenario),
    }
    assumptions = [*demand.assumptions, _of_approach(approach, since, free)]
    return Verdict(
        *TORQUE_BUDGET,
        holds,
        margin,
        bound,
        assumptions,
        _statement(members, used, torque, limit, step, change, reached, free_after, free),
        [] if holds else _remedies(scenario, family, steady, limit, change, torque, step),
        since if holds else None,
    )


def along_the_motion(scenario: Scenario, demand: Demand, members: Members) -> tuple[Floats, Floats]:
    """Return the largest torque and the largest change of it in a period, of each joint over the set [n]."""
    belief, motion = Belief.of(scenario, members.plant), Motion.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    known = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.coulomb * np.tanh(motion.dq / belief.smoothing)
    torques = known - np.einsum("kij,mkj->mki", mass, demand.push)
    parts = np.zeros((len(torques), 0, *known.shape))
    if demand.effects is not None:
        parts = np.einsum("kij,mekj->meki", mass, demand.effects)
    between = 0.0 if demand.jumps is None else np.einsum("kij,kj->ki", np.abs(mass), demand.jumps)
    torque = (np.abs(torques) + np.abs(parts).sum(axis=1) + between).max(axis=(0, 1))
    steps = np.abs(np.diff(torques, axis=1)) + np.abs(np.diff(parts, axis=2)).sum(axis=1)
    return torque, steps.max(axis=(0, 1)) if steps.shape[1] else np.zeros_like(torque)


def limits_of(scenario: Scenario, joints: int) -> tuple[Floats, Floats]:
    """Return the drives' limits of torque [n], N m or N, and torque rate [n], N m/s or N/s; inf without a limit."""
    own = scenario.plant if isinstance(scenario.plant, Plant) else scenario.plant.own
    actuator = own.actuator
    if actuator is None:
        return np.full(joints, np.inf), np.full(joints, np.inf)
    torque, rate = (
        np.broadcast_to(np.asarray(limit, float), joints) for limit in (actuator.limits.torque, actuator.limits.rate)
    )
    return torque, rate


def _of_approach(approach: Approach, since: float | None, free: bool) -> Assumption:
    runs = (
        f"{counted(approach.runs, 'simulated run')} of {approach.until:.3g} s, with arms and starts at ends of the set"
    )
    if not approach.ended:
        return Assumption(f"approach to the reference: not every run reaches its end, of {runs}", "fails")
    if since is None:
        return Assumption(f"approach to the reference: no limit is reached in {runs}", "tested")
    if free:
        return Assumption(f"approach to the reference: limits are reached until {since:.3g} s in {runs}", "tested")
    return Assumption(f"approach to the reference: limits are reached up to its end in {runs}", "fails")


def _statement(
    members: Members,
    used: Floats,
    torque: Floats,
    limit: Floats,
    step: Floats,
    change: Floats,
    reached: Flags,
    free_after: Floats,
    free: bool,
) -> str:
    robot = members.plant.robot
    joint = int(np.argmax(used))
    unit, name = robot.torque_units[joint], robot.joint_names[joint]
    text = (
        f"along the motion `{name}` uses {used[joint]:.0%} of its drive: up to {torque[joint]:.4g} of "
        f"{limit[joint]:.4g} {unit}, and {step[joint]:.3g} of {change[joint]:.3g} {unit} a period"
    )
    if not reached.any():
        return f"{text}; on the approach no limit is reached"
    last = robot.joint_names[int(np.argmax(np.where(reached, free_after, -1.0)))]
    if not free:
        return f"{text}; on the approach limits are reached up to the end of the simulation, the last by `{last}`"
    return (
        f"{text}; on the approach limits are reached until {float(np.max(free_after)):.3g} s, the last by `{last}`: "
        "the other certificates apply from then on"
    )


def _remedies(
    scenario: Scenario,
    family: Family | None,
    steady: float,
    limit: Floats,
    change: Floats,
    torque: Floats,
    step: Floats,
) -> list[Remedy]:
    if steady >= 1.0:
        enough = [float(f"{value:.3g}") for value in 1.15 * np.maximum(torque, limit / 1.15)]
        faster = [float(f"{value:.3g}") for value in 1.15 * np.maximum(step, change / 1.15) / scenario.period]
        changes: dict[str, Any] = {}
        if (torque >= limit).any():
            changes["actuator.torque"] = enough
        if (step >= change).any():
            changes["actuator.rate"] = faster
        return [Remedy("drives that deliver the motion's torque, or a slower motion", changes)]
    return _later(scenario, family, limit, change)


def _later(scenario: Scenario, family: Family | None, limit: Floats, change: Floats) -> list[Remedy]:
    """The shortest of some longer deadlines with which no limit is reached on the approach."""
    performance: Any = getattr(scenario.description.scheme, "performance", None)
    deadline = getattr(performance, "deadline", None)
    if deadline is None or family is not None or scenario.changed:
        return []
    for factor in LONGER:
        value = (np.asarray(deadline, float) * factor).tolist()
        try:
            other = altered(scenario, {"scheme.performance.deadline": value})
        except DefinitionError:
            return []
        approach = approach_of(Members.of(other), longest=scenario.t1)
        if approach.ended and not approach.reached(limit, change).any():
            return [Remedy("more time for the approach to the reference", {"scheme.performance.deadline": value})]
    return []
