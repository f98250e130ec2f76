"""Members of an uncertainty set: the true arms and outer forces that a scenario allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms.articulated import Articulated
from slidax.plant.disturbances import AbstractDisturbance, Friction
from slidax.scenarios.family import UNTRACEABLE, Family
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertain_values import with_values
from slidax.simulation.plant import Plant

from ..sampled_scenario import Floats
from ..uncertainty_set import UncertainValue, to_canonical, uncertain_values
from .arm_motion import (
    StateSequence,
    breakpoints,
    distinct_inertias,
    disturbance_torque,
    outer_torque,
    rigid_body_torque,
)

MOVES = ("robot", "disturbance")
"""Blocks of a scenario file that define the arm and the external forces."""

CHUNK = 64
"""Members that are built together."""

MOST_ENDS = 256
"""Largest number of corners that are all evaluated."""

NAMED = 6
"""Largest number of values that a sentence names."""

BRIEF = 0.125
"""Share of the samples; a force that acts at fewer of them may lie between random instants."""

NO_EFFECT = 1e-12
"""Share of the sum of all effects below which an effect is rounding."""

INSTANTS = 64
"""Instants of the motion for the effects of uncertain values, in addition to those at which forces jump."""


@dataclass(frozen=True, eq=False)
class Members:
    """The true arms of a scenario: points of a box with one axis for each uncertain value.

    - `scenario`: its law does not know which member it moves.
    - `family`: the set.
    - `parts`: axes of which only a part is used, each with the shares of its range where this part begins and ends.
    """

    scenario: Scenario
    family: Family
    parts: tuple[tuple[int, float, float], ...] = ()

    @classmethod
    def of(cls, scenario: Scenario, family: Family | None = None) -> Members:
        """The members of a scenario's set, or of another set, such as a study's.

        Raises DefinitionError if a set is invalid.
        """
        return cls(scenario, to_canonical(Family.of(scenario.description) if family is None else family))

    @cached_property
    def axes(self) -> tuple[UncertainValue, ...]:
        """Uncertain values of the arm and its external forces."""
        space = self.family.uncertain
        axes: list[UncertainValue] = []
        for path, uncertainty in space.sets.items():
            if path.split(".")[0] in MOVES:
                axes += uncertain_values(path, uncertainty, space.leaves[path])
        for axis, low, high in self.parts:
            axes[axis] = axes[axis].between(low, high)
        return tuple(axes)

    def within(self, axis: int, low: float, high: float) -> Members:
        """The members in a part of an axis's range, from share `low` to share `high`."""
        return Members(self.scenario, self.family, (*self.parts, (axis, low, high)))

    @cached_property
    def plant(self) -> Plant:
        """The scenario's own arm, with its payload and its external forces."""
        plant = self.scenario.plant
        own = plant if isinstance(plant, Plant) else plant.own
        return Plant(own.robot, own.disturbance, load=own.load)

    def values(self, points: Floats) -> dict[str, Floats]:
        """Values by path in the scenario file, with the member as first axis.

        - `points`: of the box [P D], shares from 0 to 1.
        """
        values: dict[str, Floats] = {}
        for k, axis in enumerate(self.axes):
            before = values.get(axis.path, np.broadcast_to(axis.lower, (len(points), *axis.lower.shape)))
            values[axis.path] = axis.moved(before, points[:, k])
        return values

    def plants(self, points: Floats) -> list[Plant]:
        """The true arms, with their payloads and external forces; without sensors and drives.

        - `points`: of the box [P D], shares from 0 to 1.

        Raises DefinitionError if there is no such arm.
        """
        if not self.axes:
            return [self.plant] * len(points)
        values = self.values(np.asarray(points, float))
        try:
            numbers = [
                self._numbers({path: some[k : k + CHUNK] for path, some in values.items()})
                for k in self._chunks(points)
            ]
        except UNTRACEABLE:
            return [self._plant({path: some[k] for path, some in values.items()}) for k in range(len(points))]
        rest = eqx.filter(self._plant({path: some[0] for path, some in values.items()}), eqx.is_array, inverse=True)
        return [
            eqx.combine(jax.tree.map(lambda leaf, k=k: leaf[k], some), rest)
            for some in numbers
            for k in range(len(jax.tree.leaves(some)[0]))
        ]

    def ends(self, without: Sequence[int] = (), most: int = MOST_ENDS) -> Floats:
        """The middle of the box, and its corners in all axes that can change the inertia [P D].

        All corners up to `most`; else those of `extremes`, and the two with all values lowest and highest.

        - `without`: axes without effect.
        """
        count = len(self.axes)
        acting = self.inertial(without)
        if not acting:
            return np.full((1, count), 0.5)
        if 2 ** len(acting) <= most:
            shares = np.array(list(product((0.0, 1.0), repeat=len(acting))))
        else:
            shares = self.extremes(most)[:, acting]
            shares[:2] = [[0.0] * len(acting), [1.0] * len(acting)]
        points = np.full((len(shares) + 1, count), 0.5)
        points[1:, acting] = shares
        return points

    def inertial(self, without: Sequence[int] = ()) -> list[int]:
        """Axes that can change the inertia, but for those in `without`."""
        return [k for k in range(len(self.axes)) if k not in without and self.is_inertial(k)]

    def extremes(self, count: int) -> Floats:
        """Corners at which the set's values act together in some direction, in pairs of opposite ones [count D].

        A direction weighs the joints' torques at some times. The effect of each value on these torques decides which
        end it takes. So the corners are the same members in whatever order, and in however many equal terms, the set is
        written. A value without effect stays in its middle.
        """
        effects = self._effects
        shares = np.empty((count, len(self.axes)))
        for k in range(count):
            if k % 2:
                shares[k] = 1.0 - shares[k - 1]
                continue
            along = np.einsum("dtj,tj->d", effects, _direction(k // 2, *effects.shape[1:]))
            small = np.maximum(1e-9 * np.abs(effects).max(axis=(1, 2), initial=0.0), NO_EFFECT)
            shares[k] = np.where(along > small, 1.0, np.where(along < -small, 0.0, 0.5))
        return shares

    @cached_property
    def _effects(self) -> Floats:
        """Effect of each axis, from end to end, on the torques along the motion [D T n].

        Relative to the largest joint effect of all axes, which does not depend on how many equal terms the set is
        written in.
        """
        count, motion = len(self.axes), StateSequence.of(self.scenario)
        if not count:
            return np.zeros((0, 1, motion.joints))
        points = np.repeat([0.5, 1.0], 2 * count)[:, None] * np.ones(count)
        rows = np.arange(2 * count)
        points[2 * rows, rows % count] = 0.0
        points[2 * rows + 1, rows % count] = 1.0
        plants = self.plants(points)
        few = motion.at(np.union1d(breakpoints(plants, motion.t[-1]), self.brief), instants=INSTANTS)
        kinds, which = distinct_inertias(plants)
        torque = rigid_body_torque(kinds, few)[1][which] - outer_torque(plants, few)
        moved, at_ends = np.split(torque[1::2] - torque[::2], 2)
        # A factor of a force whose middle is 0 has an effect only where the force is not 0.
        idle = np.abs(moved).max(axis=(1, 2)) <= NO_EFFECT * np.abs(moved).sum(axis=0).max()
        moved[idle] = at_ends[idle]
        largest = np.abs(moved).sum(axis=0).max(axis=0)
        return moved / np.maximum(largest, 1e-300)

    @cached_property
    def brief(self) -> Floats:
        """Times at which brief forces, such as a contact, depend most on the set's values [K], s.

        Each value of the disturbance goes from end to end, while all others are at one end or in the middle.
        """
        motion, samples = StateSequence.of(self.scenario), [np.zeros(0, int)]
        for axis in self.of_the_disturbance:
            points = np.repeat([0.0, 0.5, 1.0], 2)[:, None] * np.ones(len(self.axes))
            points[:, axis] = np.tile([0.0, 1.0], 3)
            forces = disturbance_torque(self.plants(points), motion)
            moved = np.abs(forces[1::2] - forces[::2])
            acting = (moved > 0.0).any(axis=(0, 2)).mean()
            if 0.0 < acting < BRIEF:
                samples.append(moved.argmax(axis=1).ravel())
        return motion.t[np.unique(np.concatenate(samples))]

    @cached_property
    def of_the_disturbance(self) -> list[int]:
        """Axes that are values of the disturbance."""
        return [k for k, axis in enumerate(self.axes) if axis.path.startswith("disturbance.")]

    def is_inertial(self, axis: int) -> bool:
        """True if a value can change the inertia."""
        path = self.axes[axis].path
        return path.startswith("robot.") and path.split(".")[-1] not in ("coulomb", "viscous", "gravity_acceleration")

    def named(self, axes: Sequence[int]) -> str:
        """Names of some axes for a sentence: of many the first ones, and the number of the others."""
        names = [self.axes[k].name for k in axes]
        more = len(names) - NAMED
        return ", ".join(names) if more <= 1 else f"{', '.join(names[:NAMED])} and {more} more numbers"

    @cached_property
    def disturbances(self) -> tuple[AbstractDisturbance, AbstractDisturbance]:
        """Two disturbances with the least and with the largest value that each number has in the set.

        Each number of the disturbance depends on one axis, so it is enough to move one axis at a time.
        """
        moved = self.of_the_disturbance
        points = np.full((2 * len(moved) + 1, len(self.axes)), 0.5)
        for row, axis in enumerate(moved):
            points[2 * row + 1, axis], points[2 * row + 2, axis] = 0.0, 1.0
        disturbances = [plant.disturbance for plant in (*self.plants(points), self.plant)]
        lower, upper = (
            jax.tree.map(lambda *each, end=end: end([np.asarray(leaf) for leaf in each], axis=0), *disturbances)
            for end in (np.min, np.max)
        )
        return lower, upper

    @staticmethod
    def rubbing(plants: Sequence[Plant]) -> Friction:
        """The largest Coulomb friction of some arms' joints, with the least velocity scale of its sign change."""
        n = plants[0].robot.joints
        arms = [plant.robot for plant in plants if isinstance(plant.robot, Articulated)]
        coulomb = np.max([np.broadcast_to(np.asarray(arm.coulomb), n) for arm in arms] or [np.zeros(n)], axis=0)
        smoothing = np.min([np.broadcast_to(np.asarray(arm.smoothing), n) for arm in arms] or [np.ones(n)], axis=0)
        return Friction(jnp.asarray(coulomb), jnp.zeros(n), jnp.asarray(smoothing))

    @staticmethod
    def _chunks(points: Floats) -> range:
        return range(0, len(points), CHUNK)

    def _numbers(self, values: dict[str, Floats]) -> Any:
        """The arrays of some arms, with the arm as their first axis."""
        count = len(next(iter(values.values())))
        # The same size each time, so that this is compiled once.
        filled = {path: np.resize(some, (CHUNK, *some.shape[1:])) for path, some in values.items()}
        return jax.tree.map(lambda leaf: np.asarray(leaf)[:count], self._compiled(filled))

    @cached_property
    def _compiled(self) -> Any:
        def arrays(values: dict[str, Any]) -> Any:
            # Everything that does not depend on these values is computed, and checked, during tracing.
            with jax.ensure_compile_time_eval():
                return eqx.filter(self._plant(values), eqx.is_array)

        return jax.jit(jax.vmap(arrays))

    @cached_property
    def _actual(self) -> Any:
        """The scenario's description, in which every path exists."""
        middle = self.values(np.full((1, len(self.axes)), 0.5))
        return self.family.case({path: some[0] for path, some in middle.items()}).as_it_is()

    def _plant(self, values: dict[str, Any]) -> Plant:
        actual = with_values(self._actual, values)
        arms = actual.robot.build()
        return Plant(arms.true, actual.disturbance.build(), load=arms.load)


def _direction(number: int, times: int, joints: int) -> Floats:
    """Weights of the joints' torques at some times [times joints], fixed for each number.

    The first directions weigh one joint each, with one sign; later ones all joints, with more and more sign changes.
    """
    if number < joints:
        return np.tile(np.arange(joints) == number, (times, 1)).astype(float)
    random = np.random.default_rng(number)
    phase = np.linspace(0.0, 1.0, times)[:, None] * (number // joints) + random.uniform(size=joints)
    return random.normal(size=joints) * np.cos(np.pi * phase)


CORNERS = 8
"""Number of corners."""


@lru_cache(maxsize=4)
def corner_scenarios(scenario: Scenario) -> Sequence[Scenario]:
    """Return the scenario, and scenarios at corners of its set at which its values act together.

    Raises DefinitionError if a set is empty or its path does not exist.
    """
    members = Members.of(scenario)
    family = members.family
    if not family.space.sets:
        return [scenario]
    shares = np.array([np.zeros(family.space.dimensions), np.full(family.space.dimensions, np.nextafter(1.0, 0.0))])
    values = {
        **family.space.values(np.resize(shares, (CORNERS, family.space.dimensions))),
        **members.values(members.extremes(CORNERS)),
    }
    cases = [{path: some[k] for path, some in values.items()} for k in range(CORNERS)]
    return [scenario, *(family.scenario(case, f"{scenario.name}, corner {k}") for k, case in enumerate(cases))]
