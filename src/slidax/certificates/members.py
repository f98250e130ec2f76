"""The arm, its motion and its disturbance at sampled times, and the set of a scenario in one form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._types import State
from slidax.diagnosis.along import along
from slidax.robots import AbstractRobot
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty import Space
from slidax.simulation import Plant

from .each import Each
from .ends import ends_of

Floats = NDArray[np.floating[Any]]

SAMPLES = 4001
"""Of a motion, at most."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A scenario's reference at sampled times, with its true arm and its law's arm there.

    The times are apart by no multiple of the period, since what repeats with it would be seen at one phase alone.

    - `scenario`: whose.
    - `first`: the first time [s].
    """

    scenario: Scenario
    first: float = 0.0

    @cached_property
    def times(self) -> Floats:
        """When it is looked at, s."""
        count = min(SAMPLES, round((self.scenario.t1 - self.first) / self.scenario.period) + 1)
        # Steps by the golden ratio fill each phase of whatever repeats.
        shift = (np.arange(count) * 0.618033988749895) % 1.0
        spread = (np.arange(count) + shift) / max(count, 1)
        return self.first + spread * (self.scenario.t1 - self.first)

    @cached_property
    def states(self) -> tuple[Floats, Floats, Floats]:
        """`q_d`, `q̇_d`, `q̈_d` at these times, [N n]."""
        return self.reference(self.times)

    def reference(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """`q_d`, `q̇_d`, `q̈_d`, [N n].

        - `times`: when, [N], s.
        """
        q, dq, ddq = self._reference(times)
        return q, dq, ddq

    @cached_property
    def _reference(self) -> Each:
        def at(t: Any) -> Any:
            found = self.scenario.trajectory.reference(t)
            return found.q, found.dq, found.ddq

        return Each(at)

    @cached_property
    def plant(self) -> Plant:
        """The arm as it is, with its own equations."""
        plant = self.scenario.plant
        return plant if isinstance(plant, Plant) else plant.own

    def of_arm(self, robot: AbstractRobot) -> tuple[Floats, Floats]:
        """`M` [N n n] and `C q̇ + G` [N n] along the motion.

        - `robot`: whose.
        """
        return along(robot, *self.states[:2])

    @cached_property
    def truth(self) -> tuple[Floats, Floats]:
        """M and `C q̇ + G + F` of the true arm with what it carries at each time."""
        mass, bias = self.of_arm(self.plant.robot)
        load = self.plant.load
        if load is not None:
            carried = (self.times >= float(load.attached)) & (self.times < float(load.released))
            loaded, heavier = self.of_arm(load.on(self.plant.robot, load.attached))
            mass, bias = np.where(carried[:, None, None], loaded, mass), np.where(carried[:, None], heavier, bias)
        return mass, bias + Each(self.plant.robot.friction)(self.states[1])[0]

    @cached_property
    def pushed(self) -> Floats:
        """Torque from outside along the motion, [N n], N m or N."""
        push = Each(lambda t, q, dq: self.plant.disturbance(t, State(q=q, dq=dq)))
        return push(self.times, *self.states[:2])[0]


@lru_cache(maxsize=4)
def family_of(scenario: Scenario) -> Family | None:
    """All that the scenario may be, in canonical form; None if nothing of it is uncertain.

    - `scenario`: with its block `uncertainty`.
    """
    return canonical(Family.of(scenario.description)) if scenario.description.uncertainty else None


def canonical(family: Family) -> Family:
    """The same set in the one form that all certificates see, whatever the order in which it is written.

    Paths are sorted. A set of a single value is that value, so that it takes no part in what is drawn or bounded.

    - `family`: of a scenario or a study.
    """
    space, truth, left = family.uncertain, dict(family.base.truth), {}
    for path in sorted(space.sets):
        lower, upper = ends_of(space.sets[path], space.leaves[path])
        own = space.leaves[path].own
        if not np.array_equal(lower, upper):
            left[path] = space.sets[path]
        elif own is None or not np.array_equal(np.broadcast_to(own, np.shape(lower)), lower):
            truth[path] = np.asarray(lower).tolist()
    base = family.base if truth == family.base.truth else family.base.model_copy(update={"truth": truth})
    return replace(family, base=base, uncertain=Space({path: space.leaves[path] for path in left}, left))
