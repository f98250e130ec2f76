"""The approach from the start to the reference, simulated for members and starts at ends of a set."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import equinox as eqx
import jax
import numpy as np

from slidax._types import State
from slidax.scenarios import Scenario
from slidax.simulation import Plant

from ..each import Flags, Floats
from .members import Members
from .width import width_along

RUNS = 16
"""Number of simulated members and starts; the first is the scenario's own."""

SETTLED = 1.05
"""Factor of the final envelope: the approach ends when the envelope is that narrow, and a quarter later."""

AT_LIMIT = 0.999
"""Share of a limit from which on a torque is at its limit."""


@dataclass(frozen=True, eq=False)
class Approach:
    """Results of the simulated approaches.

    - `tau`: torques [R N n], N m or N; nan after the end of a run.
    - `t`: times [N], s.
    - `error`, `error_rate`: the largest of each joint at the start, [n].
    - `ended`: True if every run reached its end.
    """

    tau: Floats
    t: Floats
    error: Floats
    error_rate: Floats
    ended: bool

    @property
    def runs(self) -> int:
        return len(self.tau)

    @property
    def until(self) -> float:
        """End time, s."""
        return float(self.t[-1])

    @property
    def peak(self) -> Floats:
        """The largest |τ| of each joint [n]."""
        return np.nanmax(np.abs(self.tau), axis=(0, 1))

    @property
    def step(self) -> Floats:
        """The largest |τ(k+1) - τ(k)| of each joint [n]."""
        return np.nanmax(np.abs(np.diff(self.tau, axis=1)), axis=(0, 1))

    def after(self, time: float) -> Approach:
        """The approach from a time on, s."""
        late = self.t >= time
        return replace(self, tau=self.tau[:, late], t=self.t[late])

    def reached(self, limit: Floats, change: Floats) -> Flags:
        """True for each joint that was at a limit [n].

        - `limit`: of the torque [n]; `change`: of its change in a period [n].
        """
        return (self.peak >= AT_LIMIT * limit) | (self.step >= AT_LIMIT * change)

    def free_after(self, limit: Floats, change: Floats) -> Floats:
        """Time from which on each joint is at no limit [n], s."""
        with np.errstate(invalid="ignore"):
            at = np.abs(self.tau) >= AT_LIMIT * limit
            at[:, 1:] |= np.abs(np.diff(self.tau, axis=1)) >= AT_LIMIT * change
        some = at.any(axis=0)
        last = np.where(some.any(axis=0), len(self.t) - 1 - np.argmax(some[::-1], axis=0), -1)
        return np.where(last >= 0, self.t[np.minimum(last + 1, len(self.t) - 1)], 0.0)


def approach_of(members: Members, longest: float = np.inf) -> Approach:
    """Simulate the approach of members and starts at ends of a set, for at most `longest` seconds."""
    scenario = members.scenario
    until = min(settled_at(scenario), longest, scenario.t1)
    periods = max(round(until / scenario.period), 2)
    short = scenario.replace(t1=periods * scenario.period, outside="recover", log_every=1)
    plants, starts = ends_of(members)
    leaves = [jax.tree.leaves(_numbers(plant)) for plant in plants]
    tree = jax.tree.structure(_numbers(plants[0]))
    rest = eqx.filter(_moved(plants[0]), eqx.is_array, inverse=True)
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
        left = iter(numbers)
        all_of = [next(left) if differs else some[0] for some, differs in zip(stacked, varies, strict=True)]
        robot, disturbance, load = eqx.combine(jax.tree.unflatten(tree, all_of), rest)
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
    return Approach(tau, t, np.abs(error).max(axis=0), np.abs(rate).max(axis=0), bool(valid[:, -1].all()))


def _moved(plant: Plant) -> Any:
    return plant.robot, plant.disturbance, plant.load


def _numbers(plant: Plant) -> Any:
    return eqx.filter(_moved(plant), eqx.is_array)


def settled_at(scenario: Scenario) -> float:
    """Return the time when the envelope is nearly at its final width, and a quarter more, s; t1 without an envelope."""
    t = np.linspace(0.0, scenario.t1, 400)
    width = width_along(scenario, t)
    if width is None:
        return scenario.t1
    narrow = (width <= SETTLED * width[-1]).all(axis=1)
    return float(min(1.25 * t[int(np.argmax(narrow))] + 0.1, scenario.t1))


def ends_of(members: Members) -> tuple[list[Plant], list[tuple[Floats, Floats]]]:
    """Return members and random starts at ends of the set, the scenario's own first."""
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
