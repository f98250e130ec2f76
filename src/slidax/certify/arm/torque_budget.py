"""The certificate `torque_budget`: torques and torque rates within the limits of the drives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.analysis.cause import Remedy
from slidax.core.errors import DefinitionError, count_noun, percent
from slidax.core.types import State
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from ..certificate import ARM, Assumption, Verdict, certificate
from ..sampled_scenario import Flags, Floats, envelope_width
from .arm_motion import INSTANTS, NominalModel, StateSequence, distinct_inertias, rigid_body_torque
from .demand import Demand, compute_demand
from .members import Members

RUNS = 16
"""Number of simulated pairs of a member and a start; the first pair is the scenario's own."""

SETTLED = 1.05
"""Ratio of the envelope to its final width at which the envelope counts as narrow."""

AT_LIMIT = 0.999
"""Share of a limit above which a torque counts as limited."""


@dataclass(frozen=True, eq=False)
class ApproachRuns:
    """Results of the simulated approach to the reference: from the start until the envelope is narrow.

    - `tau`: torques [runs times n], N m or N; nan after the end of a run.
    - `t`: sample times [times], s.
    - `error`, `error_rate`: largest |e| and |ė| of each joint at the start [n].
    - `ended`: True if every run reached its end.
    """

    tau: Floats
    t: Floats
    error: Floats
    error_rate: Floats
    ended: bool

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.tau)

    @property
    def until(self) -> float:
        """End time, s."""
        return float(self.t[-1])

    @property
    def peak(self) -> Floats:
        """Largest |τ| of each joint in all runs [n], N m or N."""
        return np.nanmax(np.abs(self.tau), axis=(0, 1))

    @property
    def step(self) -> Floats:
        """Largest |τ(k+1) - τ(k)| of each joint from one period to the next [n], N m or N."""
        return np.nanmax(np.abs(np.diff(self.tau, axis=1)), axis=(0, 1))

    def after(self, time: float) -> ApproachRuns:
        """Return the part of the approach from a time on [s]."""
        later = self.t >= time
        return replace(self, tau=self.tau[:, later], t=self.t[later])

    def reached(self, limit: Floats, change: Floats) -> Flags:
        """Return True for each joint that reached a limit in some run [n].

        - `limit`: limit of |τ| [n]. `change`: limit of τ's change in a period [n].
        """
        return (self.peak >= AT_LIMIT * limit) | (self.step >= AT_LIMIT * change)

    def free_after(self, limit: Floats, change: Floats) -> Floats:
        """Return for each joint the time after which it reaches no limit in any run [n], s.

        - `limit`, `change`: as in `reached`.
        """
        with np.errstate(invalid="ignore"):
            limited = np.abs(self.tau) >= AT_LIMIT * limit
            limited[:, 1:] |= np.abs(np.diff(self.tau, axis=1)) >= AT_LIMIT * change
        in_any_run = limited.any(axis=0)
        last = np.where(in_any_run.any(axis=0), len(self.t) - 1 - np.argmax(in_any_run[::-1], axis=0), -1)
        return np.where(last >= 0, self.t[np.minimum(last + 1, len(self.t) - 1)], 0.0)

    def since(self, limit: Floats, change: Floats) -> float | None:
        """Return the time after which no joint reaches a limit [s]; None if none does. Arguments as in `reached`."""
        return float(np.max(self.free_after(limit, change))) if self.reached(limit, change).any() else None

    def becomes_free(self, limit: Floats, change: Floats) -> bool:
        """True if all runs end, and no limit is reached in the last part `FREE` of them. Arguments as in `reached`."""
        since = self.since(limit, change)
        return self.ended and (since is None or since <= (1.0 - FREE) * self.until)


def simulate_approach(members: Members, longest: float = np.inf) -> ApproachRuns:
    """Simulate the approach to the reference for members and starts at corners of a set, for at most `longest` [s]."""
    scenario = members.scenario
    until = min(narrow_time(scenario), longest, scenario.t1)
    periods = max(round(until / scenario.period), 2)
    short = scenario.replace(t1=periods * scenario.period, outside="recover", log_every=1)
    plants, starts = extreme_members(members)
    leaves = [jax.tree.leaves(_arrays(plant)) for plant in plants]
    tree = jax.tree.structure(_arrays(plants[0]))
    rest = eqx.filter(_varied_parts(plants[0]), eqx.is_array, inverse=True)
    stacked = [np.stack([np.asarray(own[k], float) for own in leaves]) for k in range(len(leaves[0]))]
    # Values that all runs share are constants of the compiled loop.
    varies = [bool((some != some[:1]).any()) for some in stacked]
    varied = (
        [some for some, differs in zip(stacked, varies, strict=True) if differs],
        np.stack([q for q, _ in starts]),
        np.stack([dq for _, dq in starts]),
    )

    def case(base: Scenario, values: Any) -> Scenario:
        numbers, q, dq = values
        remaining = iter(numbers)
        arrays = [
            next(remaining) if differs else jnp.asarray(some[0]) for some, differs in zip(stacked, varies, strict=True)
        ]
        robot, disturbance, load = eqx.combine(jax.tree.unflatten(tree, arrays), rest)
        own: Any = base.plant if isinstance(base.plant, Plant) else base.plant.own
        plant = Plant(robot, disturbance, own.sensor, own.actuator, load)
        return base.replace(plant=plant, state0=State(q=q, dq=dq))

    run = short.simulate_batch(case, varied, log_every=1)
    log = run.log
    assert log is not None
    valid = np.asarray(log.valid)
    tau = np.where(valid[..., None], np.asarray(log.tau), np.nan)
    t = scenario.period * np.arange(tau.shape[1])
    error, rate = np.asarray(log.e)[:, 0], np.asarray(log.de)[:, 0]
    return ApproachRuns(tau, t, np.abs(error).max(axis=0), np.abs(rate).max(axis=0), bool(valid[:, -1].all()))


def _varied_parts(plant: Plant) -> Any:
    return plant.robot, plant.disturbance, plant.load


def _arrays(plant: Plant) -> Any:
    return eqx.filter(_varied_parts(plant), eqx.is_array)


def narrow_time(scenario: Scenario) -> float:
    """Return the end of the simulated approach [s]; the end of the scenario, t1, for a law without an envelope.

    It is 1.25 times the time at which the envelope is narrow (`SETTLED`), plus 0.1 s.
    """
    t = np.linspace(0.0, scenario.t1, 400)
    width = envelope_width(scenario, t)
    if width is None:
        return scenario.t1
    narrow = (width <= SETTLED * width[-1]).all(axis=1)
    return float(min(1.25 * t[int(np.argmax(narrow))] + 0.1, scenario.t1))


def extreme_members(members: Members) -> tuple[list[Plant], list[tuple[Floats, Floats]]]:
    """Return true arms at corners of the set, and a start (q, dq) for each, at a random corner of the set's starts.

    The first arm and the first start are the scenario's own.
    """
    scenario, count = members.scenario, len(members.axes)
    own = np.asarray(scenario.state0.q, float), np.asarray(scenario.state0.dq, float)
    space = members.family.uncertain
    free = [path for path in ("start.q", "start.dq") if path in space.sets]
    runs = RUNS if count or free else 1
    points = np.full((runs, count), 0.5)
    points[1:] = members.extremes(runs - 1)
    plants = members.plants(points)
    plants[0] = members.plant
    states = {path: np.tile(value, (runs, 1)) for path, value in zip(("start.q", "start.dq"), own, strict=True)}
    for path in free:
        uncertainty, leaf = space.sets[path], space.leaves[path]
        random = np.random.default_rng([6, crc32(path.encode())])
        corners = random.integers(0, 2, (runs, uncertainty.coordinates(leaf))).astype(float)
        drawn = np.asarray(uncertainty.values(np.minimum(corners, np.nextafter(1.0, 0.0)), leaf), float)
        states[path][1:] = drawn.reshape(runs, -1)[1:]
    return plants, list(zip(states["start.q"], states["start.dq"], strict=True))


BRAKING_FACTOR = 1.6
"""Radius of a recovery's new envelope over the distance in which a joint brakes: the default `room` of `Recovery`."""


@dataclass(frozen=True)
class BrakingMargin:
    """Braking capability along the motion.

    - `acceleration`: a, the acceleration that each joint has left while the others follow the motion [n], rad/s² or
      m/s². It is inf without limits, and 0 if the motion needs the whole torque.
    - `lead`: c of the led error `e + c ė`, which the law feeds back [s]. `c = H - h/2` with the law's horizon H and the
      period h.
    """

    acceleration: Floats
    lead: float

    def room(self, error: Floats, rate: Floats) -> Floats:
        """Return the half width of an envelope in which a joint can brake [n]: `1.6 (|e| + c |ė| + ė²/(2a))`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(rate > 0, rate * rate / (2.0 * self.acceleration), 0.0)
        return BRAKING_FACTOR * (error + self.lead * rate + distance)

    def speed(self, scenario: Scenario) -> Floats:
        """Return the largest |ė| at e = 0 from which a joint can brake in the final envelope [n].

        It is the largest v with `v²/(2a) + c v <= ρ∞`.
        """
        width = envelope_width(scenario, np.array([scenario.t1]))
        if width is None:
            return np.full_like(self.acceleration, np.inf)
        a, c = self.acceleration, self.lead
        with np.errstate(invalid="ignore"):
            speed = np.sqrt((a * c) ** 2 + 2.0 * a * width[0]) - a * c
        return np.where(np.isfinite(a), speed, width[0] / c)


def braking_margin(scenario: Scenario, members: Members, limit: Floats, torque: Floats) -> BrakingMargin:
    """Return the acceleration that the drives can deliver in addition to the motion, for braking.

    It is `a_i = (τ_max,i - max |τ_i|)/max M_ii` over the motion. max |τ_i| is `torque`, and max M_ii is
    the largest of the law's initial inertia and of the members at corners of the set.

    - `limit`: limits of the torques [n], N m or N.
    - `torque`: largest |τ| along the motion over the set [n], N m or N.
    """
    motion = StateSequence.of(scenario)
    belief = NominalModel.of(scenario, members.plant)
    few = motion.every(INSTANTS)
    masses = [belief.mass_and_bias(few.t, few.q, few.dq)[0][None]]
    masses.append(rigid_body_torque(distinct_inertias(members.plants(members.ends()))[0], few)[0])
    heaviest = np.diagonal(np.concatenate(masses), axis1=2, axis2=3).max(axis=(0, 1))
    law = scenario.controller
    horizon = float(law.horizon) if isinstance(law, SampledData) and law.horizon is not None else scenario.period
    return BrakingMargin(np.maximum(limit - torque, 0.0) / heaviest, horizon - 0.5 * scenario.period)


TORQUE_BUDGET = "torque_budget", "the drives deliver the torque"

FREE = 0.1
"""Share of the simulated approach in which no limit may be reached: the last part."""

LONGER = (1.5, 2.0, 3.0, 4.0)
"""Factors on the envelope's deadline in the search for a remedy."""


@certificate(*TORQUE_BUDGET, covers=ARM)
def torque_budget(scenario: Scenario, demand: Demand | None = None, family: Family | None = None) -> Verdict:
    """Check torque and torque rate of every member against the limits of the drives.

    Along the motion each member's torque is computed: `τ = M̂ (q̈_r - w*) + n̂`. Here M̂ is the law's inertia, n̂ its
    Coriolis torque, gravity and friction, q̈_r the reference's acceleration, and w* the disturbance of `Demand`.
    On the approach from the start to the reference torques are simulated, for members and starts at corners of the set.
    If a limit is reached only on the approach, the certificate holds from the time `since`, after which no limit is
    reached. The other certificates apply from then on.

    The verdict's `bound` has for each joint: `torque` and its largest change in a period, `torque_step`, along the
    motion; the same on the approach, `approach_torque` and `approach_torque_step`; `free_after` of `ApproachRuns`; and
    of `BrakingMargin` `acceleration` (`acceleration_left`), `room` (`recovery_room`) and `speed` (`braking_speed`).

    - `demand`: demand of the set; computed by default.
    - `family`: a set in place of the scenario's own, such as a study's; `demand` must belong to it.
    """
    members = Members.of(scenario, family)
    n = members.plant.robot.joints
    limit, rate = torque_limits(scenario, n)
    if not np.isfinite(limit).any() and not np.isfinite(rate).any():
        text = "the drives have no limits: set `actuator.torque`, `actuator.rate`"
        return Verdict(*TORQUE_BUDGET, None, None, {}, (), text)
    demand = compute_demand(scenario, family) if demand is None else demand
    torque, step = motion_torques(scenario, demand, members)
    change = rate * scenario.period
    approach = simulate_approach(members)
    used = np.maximum(torque / limit, step / change)
    reached = approach.reached(limit, change)
    steady = float(used.max())
    free_after, since = approach.free_after(limit, change), approach.since(limit, change)
    free = approach.becomes_free(limit, change)
    holds = bool(steady < 1.0 and free)
    rest = approach if since is None or not free else approach.after(since)
    share = max(steady, float(np.max(rest.peak / limit)), float(np.max(rest.step / change)))
    # A limit that is reached leaves no margin: the share is 1 up to rounding.
    margin = 1.0 - share if free or steady >= 1.0 else None
    braking = braking_margin(scenario, members, limit, torque)
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
    assumptions = [*demand.assumptions, _approach_assumption(approach, since, free)]
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


def motion_torques(scenario: Scenario, demand: Demand, members: Members) -> tuple[Floats, Floats]:
    """Return each joint's largest |τ| along the motion over all members, and the largest change in a period [n]."""
    belief, motion = NominalModel.of(scenario, members.plant), StateSequence.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    nominal = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.coulomb * np.tanh(motion.dq / belief.smoothing)
    torques = nominal - np.einsum("kij,mkj->mki", mass, demand.disturbance)
    effects = np.zeros((len(torques), 0, *nominal.shape))
    if demand.effects is not None:
        effects = np.einsum("kij,mekj->meki", mass, demand.effects)
    between_samples = 0.0 if demand.jumps is None else np.einsum("kij,kj->ki", np.abs(mass), demand.jumps)
    torque = (np.abs(torques) + np.abs(effects).sum(axis=1) + between_samples).max(axis=(0, 1))
    steps = np.abs(np.diff(torques, axis=1)) + np.abs(np.diff(effects, axis=2)).sum(axis=1)
    return torque, steps.max(axis=(0, 1)) if steps.shape[1] else np.zeros_like(torque)


def torque_limits(scenario: Scenario, joints: int) -> tuple[Floats, Floats]:
    """Return the drives' limits of torque [n], N m or N, and torque rate [n], N m/s or N/s; inf without a limit."""
    own = scenario.plant if isinstance(scenario.plant, Plant) else scenario.plant.own
    actuator = own.actuator
    if actuator is None:
        return np.full(joints, np.inf), np.full(joints, np.inf)
    torque, rate = (
        np.broadcast_to(np.asarray(limit, float), joints) for limit in (actuator.limits.torque, actuator.limits.rate)
    )
    return torque, rate


def _approach_assumption(approach: ApproachRuns, since: float | None, free: bool) -> Assumption:
    count = count_noun(approach.runs, "simulated run")
    runs = f"{count} of {approach.until:.3g} s, with arms and starts at corners of the set"
    if not approach.ended:
        return Assumption(f"approach to the reference: a run ends early, of {runs}", "fails")
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
        f"Along the motion `{name}` uses {percent(used[joint])} of its drive: up to {torque[joint]:.4g} of "
        f"{limit[joint]:.4g} {unit}, and a torque step of up to {step[joint]:.3g} of {change[joint]:.3g} {unit} "
        "per period."
    )
    if not reached.any():
        return f"{text} On the approach no limit is reached."
    last = robot.joint_names[int(np.argmax(np.where(reached, free_after, -1.0)))]
    if not free:
        return f"{text} On the approach limits are reached up to the end of the simulation, the last by `{last}`."
    return (
        f"{text} On the approach limits are reached until {float(np.max(free_after)):.3g} s, the last by `{last}`: "
        "the other certificates apply from then on."
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
    return _longer_deadline(scenario, family, limit, change)


def _longer_deadline(scenario: Scenario, family: Family | None, limit: Floats, change: Floats) -> list[Remedy]:
    """Return a remedy with the shortest deadline of `LONGER` with which the approach becomes free; none without one."""
    scheme: Any = scenario.description.scheme
    owner, path = scheme, "scheme.performance.deadline"
    if hasattr(scheme, "transformation"):
        owner, path = scheme.transformation, "scheme.transformation.performance.deadline"
    deadline = getattr(getattr(owner, "performance", None), "deadline", None)
    if deadline is None or family is not None or scenario.changed:
        return []
    for factor in LONGER:
        value = np.vectorize(lambda later: float(f"{later:.3g}"))(np.asarray(deadline, float) * factor).tolist()
        try:
            other = alter(scenario, {path: value})
        except DefinitionError:
            return []
        approach = simulate_approach(Members.of(other), longest=scenario.t1)
        if approach.becomes_free(limit, change):
            return [Remedy("more time for the approach to the reference", {path: value})]
    return []
