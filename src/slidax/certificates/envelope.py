"""A scenario's reference, true arm and envelope at sampled times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from slidax.diagnosis.along import along
from slidax.robots import AbstractRobot
from slidax.scenarios import Scenario
from slidax.simulation import Plant

from .each import Each, Floats

SAMPLES = 4001
"""Largest number of samples of a motion."""


@dataclass(frozen=True, eq=False)
class SampledReference:
    """A scenario's reference at sampled times, with its true arm and its law's arm there.

    The times are no multiples of the period apart: whatever repeats with the period would be seen at one phase only.

    - `first`: the first time, s.
    """

    scenario: Scenario
    first: float = 0.0

    @cached_property
    def times(self) -> Floats:
        """Sample times, s."""
        count = min(SAMPLES, round((self.scenario.t1 - self.first) / self.scenario.period) + 1)
        # Steps by the golden ratio fill each phase of whatever repeats.
        shift = (np.arange(count) * 0.618033988749895) % 1.0
        spread = (np.arange(count) + shift) / max(count, 1)
        return self.first + spread * (self.scenario.t1 - self.first)

    @cached_property
    def states(self) -> tuple[Floats, Floats, Floats]:
        """`q_d`, `q̇_d`, `q̈_d` at the sample times, [N n]."""
        return self.reference(self.times)

    def reference(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return `q_d`, `q̇_d`, `q̈_d` at given times, [N n]."""
        q, dq, ddq = self._reference(times)
        return q, dq, ddq

    @cached_property
    def _reference(self) -> Each:
        def at(t: Any) -> Any:
            reference = self.scenario.trajectory.reference(t)
            return reference.q, reference.dq, reference.ddq

        return Each(at)

    @cached_property
    def plant(self) -> Plant:
        """The true arm, with its own equations."""
        plant = self.scenario.plant
        return plant if isinstance(plant, Plant) else plant.own

    def of_arm(self, robot: AbstractRobot) -> tuple[Floats, Floats]:
        """Return `M` [N n n] and `C q̇ + G` [N n] of an arm along the motion."""
        return along(robot, *self.states[:2])

    @cached_property
    def truth(self) -> tuple[Floats, Floats]:
        """M and `C q̇ + G + F` of the true arm with its payload at each time."""
        mass, bias = self.of_arm(self.plant.robot)
        load = self.plant.load
        if load is not None:
            carried = (self.times >= float(load.attached)) & (self.times < float(load.released))
            loaded, heavier = self.of_arm(load.on(self.plant.robot, load.attached))
            mass, bias = np.where(carried[:, None, None], loaded, mass), np.where(carried[:, None], heavier, bias)
        return mass, bias + Each(self.plant.robot.friction)(self.states[1])[0]

    @cached_property
    def pushed(self) -> Floats:
        """External torque along the motion, [N n], N m or N."""
        push = Each(lambda t, q, dq: self.plant.disturbance(t, State(q=q, dq=dq)))
        return push(self.times, *self.states[:2])[0]


def draws_envelope(scenario: Scenario) -> bool:
    """Return True if the law has an envelope."""
    law = scenario.controller
    return eqx.filter_eval_shape(lambda: _at(scenario, law.joints)) is not None


def envelope_of(scenario: Scenario, times: Floats) -> tuple[Floats, Floats] | None:
    """Return the lower and upper bounds for the scenario's own start, [N n]; None for a law without an envelope.

    - `times`: [N], s.
    """
    if not draws_envelope(scenario):
        return None
    law, state0 = scenario.controller, scenario.state0

    def at(t: Any, q: Any, dq: Any) -> Any:
        memory = law.init(jnp.zeros(()), State(q=q, dq=dq), scenario.trajectory.reference(jnp.zeros(())))
        envelope = law.envelope(t, memory)
        assert envelope is not None
        return envelope.lower, envelope.upper

    rows = len(times)
    lower, upper = Each(at)(
        times, *(np.broadcast_to(np.asarray(value), (rows, law.joints)) for value in (state0.q, state0.dq))
    )
    return lower, upper


def _at(scenario: Scenario, joints: int) -> Any:
    t, law = jnp.zeros(()), scenario.controller
    reference = scenario.trajectory.reference(t)
    return law.envelope(t, law.init(t, State(q=jnp.zeros(joints), dq=jnp.zeros(joints)), reference))
