"""Which arms and outer forces the uncertainty of a scenario allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.disturbances import AbstractDisturbance, Friction
from slidax.robots import Articulated
from slidax.scenarios import Scenario
from slidax.scenarios.family import UNTRACEABLE, Family
from slidax.scenarios.uncertainty import with_values
from slidax.simulation import Plant

from ..members import canonical
from .axes import Axis, axes_of
from .evaluated import Floats
from .motion import Motion, breakpoints, disturbed, kinds_of, needed, outer

MOVES = ("robot", "disturbance")
"""The blocks of a scenario file that say what moves and pushes the arm."""

CHUNK = 64
"""Members that are built together."""

MOST_ENDS = 256
"""Corners of a box that are looked at, one by one."""

NAMED = 6
"""Axes that a sentence names, if there are many."""

BRIEF = 0.125
"""Share of the samples; a force that acts at fewer of them may lie between instants drawn at random."""

NO_EFFECT = 1e-12
"""Share of all effects together, below which one is rounding."""

INSTANTS = 64
"""Of the motion, at which the effects of uncertain numbers are compared, besides those at which forces jump."""


@dataclass(frozen=True, eq=False)
class Members:
    """The true arms that a scenario allows: points of a box, one axis for each number that is uncertain.

    - `scenario`: with the law that does not know which of them it moves.
    - `family`: which arms; that of the scenario's own `uncertainty` if it was not given.
    - `parts`: numbers of axes of which only a part is gone, each with the shares of its way where that begins and ends.
    """

    scenario: Scenario
    family: Family
    parts: tuple[tuple[int, float, float], ...] = ()

    @classmethod
    def of(cls, scenario: Scenario, family: Family | None = None) -> Members:
        """The members of a scenario's set.

        - `scenario`: whose.
        - `family`: another set than that of the scenario's own `uncertainty`, such as a study's.

        Raises DefinitionError if a set is invalid.
        """
        return cls(scenario, canonical(Family.of(scenario.description) if family is None else family))

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """What can be otherwise of the arm and of what pushes it."""
        space = self.family.uncertain
        found: list[Axis] = []
        for path, one in space.sets.items():
            if path.split(".")[0] in MOVES:
                found += axes_of(path, one, space.leaves[path])
        for axis, low, high in self.parts:
            found[axis] = found[axis].between(low, high)
        return tuple(found)

    def within(self, axis: int, low: float, high: float) -> Members:
        """Those of a part of an axis's way.

        - `axis`: its number.
        - `low`, `high`: shares of its way.
        """
        return Members(self.scenario, self.family, (*self.parts, (axis, low, high)))

    @property
    def beside(self) -> tuple[str, ...]:
        """The paths of what is uncertain, and is neither of the arm nor of what pushes it: sensors, drives, start."""
        return tuple(path for path in self.family.uncertain.sets if path.split(".")[0] not in MOVES)

    @cached_property
    def plant(self) -> Plant:
        """The scenario's own arm, with what it carries and what pushes it."""
        plant = self.scenario.plant
        own = plant if isinstance(plant, Plant) else plant.own
        return Plant(own.robot, own.disturbance, load=own.load)

    def values(self, points: Floats) -> dict[str, Floats]:
        """What a scenario file would have, by path, with the member as the first axis.

        - `points`: of the box [P D], shares from 0 to 1.
        """
        found: dict[str, Floats] = {}
        for k, axis in enumerate(self.axes):
            before = found.get(axis.path, np.broadcast_to(axis.lower, (len(points), *axis.lower.shape)))
            found[axis.path] = axis.moved(before, points[:, k])
        return found

    def plants(self, points: Floats) -> list[Plant]:
        """The true arms, with what they carry and what pushes them; no sensors, no drives.

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
        """The middle of the box, and its corners in what can change the inertia [P D].

        All of them up to some number; else those of `extremes`, and the two that are lowest and highest throughout.

        - `without`: axes that change nothing.
        - `most`: corners, at most.
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
        """The axes that can change the inertia.

        - `without`: axes that change nothing.
        """
        return [k for k in range(len(self.axes)) if k not in without and self.is_inertial(k)]

    def extremes(self, count: int) -> Floats:
        """Corners in which the set's numbers act together in some direction, in pairs of opposite ones [count D].

        A direction weighs the joints' torques at some times. Which end each number takes follows from its own effect on
        the torques, so that the corners are the same members in whatever order, and in however many equal terms, the
        set is written. A number without effect stays in its middle.

        - `count`: of the corners.
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

        Relative to the largest effect that all axes have on the joint together, which is the same in however many equal
        terms the set is written.
        """
        count, motion = len(self.axes), Motion.of(self.scenario)
        if not count:
            return np.zeros((0, 1, motion.joints))
        points = np.repeat([0.5, 1.0], 2 * count)[:, None] * np.ones(count)
        rows = np.arange(2 * count)
        points[2 * rows, rows % count] = 0.0
        points[2 * rows + 1, rows % count] = 1.0
        plants = self.plants(points)
        few = motion.at(np.union1d(breakpoints(plants, motion.t[-1]), self.brief), instants=INSTANTS)
        kinds, which = kinds_of(plants)
        torque = needed(kinds, few)[1][which] - outer(plants, few)
        moved, at_ends = np.split(torque[1::2] - torque[::2], 2)
        # A factor of a force whose middle is 0 has an effect only where the force is not 0.
        idle = np.abs(moved).max(axis=(1, 2)) <= NO_EFFECT * np.abs(moved).sum(axis=0).max()
        moved[idle] = at_ends[idle]
        largest = np.abs(moved).sum(axis=0).max(axis=0)
        return moved / np.maximum(largest, 1e-300)

    @cached_property
    def brief(self) -> Floats:
        """Times at which forces that act only briefly, such as a contact, depend most on the set's numbers [K], s.

        Each number of the disturbance goes from end to end, while all others are at one end or in the middle.
        """
        motion, samples = Motion.of(self.scenario), [np.zeros(0, int)]
        for axis in self.of_the_disturbance:
            points = np.repeat([0.0, 0.5, 1.0], 2)[:, None] * np.ones(len(self.axes))
            points[:, axis] = np.tile([0.0, 1.0], 3)
            forces = disturbed(self.plants(points), motion)
            moved = np.abs(forces[1::2] - forces[::2])
            acting = (moved > 0.0).any(axis=(0, 2)).mean()
            if 0.0 < acting < BRIEF:
                samples.append(moved.argmax(axis=1).ravel())
        return motion.t[np.unique(np.concatenate(samples))]

    @cached_property
    def of_the_disturbance(self) -> list[int]:
        """The axes that are numbers of the disturbance."""
        return [k for k, axis in enumerate(self.axes) if axis.path.startswith("disturbance.")]

    def is_inertial(self, axis: int) -> bool:
        """Whether a number can change the inertia.

        - `axis`: its number.
        """
        path = self.axes[axis].path
        return path.startswith("robot.") and path.split(".")[-1] not in ("coulomb", "viscous", "gravity_acceleration")

    def named(self, axes: Sequence[int]) -> str:
        """The names of some axes for a sentence; of many the first ones, and how many more.

        - `axes`: their numbers.
        """
        names = [self.axes[k].name for k in axes]
        more = len(names) - NAMED
        return ", ".join(names) if more <= 1 else f"{', '.join(names[:NAMED])} and {more} more numbers"

    @cached_property
    def disturbances(self) -> tuple[AbstractDisturbance, AbstractDisturbance]:
        """Two disturbances with the least and with the largest value that each number has in the set.

        A number of the scenario file is one of the disturbance's, so that it is enough to move one axis at a time.
        """
        moved = self.of_the_disturbance
        points = np.full((2 * len(moved) + 1, len(self.axes)), 0.5)
        for row, axis in enumerate(moved):
            points[2 * row + 1, axis], points[2 * row + 2, axis] = 0.0, 1.0
        found = [plant.disturbance for plant in (*self.plants(points), self.plant)]
        lower, upper = (
            jax.tree.map(lambda *each, end=end: end([np.asarray(one) for one in each], axis=0), *found)
            for end in (np.min, np.max)
        )
        return lower, upper

    @staticmethod
    def rubbing(plants: Sequence[Plant]) -> Friction:
        """The largest Coulomb friction of some arms' own joints, within the least velocity in which it turns.

        - `plants`: the arms.
        """
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
        # One size, so that it is compiled once.
        filled = {path: np.resize(some, (CHUNK, *some.shape[1:])) for path, some in values.items()}
        return jax.tree.map(lambda leaf: np.asarray(leaf)[:count], self._compiled(filled))

    @cached_property
    def _compiled(self) -> Any:
        def one(given: dict[str, Any]) -> Any:
            # What does not depend on the given values is known, and checked, while this is traced.
            with jax.ensure_compile_time_eval():
                return eqx.filter(self._plant(given), eqx.is_array)

        return jax.jit(jax.vmap(one))

    @cached_property
    def _actual(self) -> Any:
        """The scenario as it is, with every path leading somewhere."""
        middle = self.values(np.full((1, len(self.axes)), 0.5))
        return self.family.case({path: some[0] for path, some in middle.items()}).as_it_is()

    def _plant(self, values: dict[str, Any]) -> Plant:
        actual = with_values(self._actual, values)
        arms = actual.robot.build()
        return Plant(arms.true, actual.disturbance.build(), load=arms.load)


def _direction(number: int, times: int, joints: int) -> Floats:
    """Weights of the joints' torques at some times [times joints], always the same for a number.

    The first ones weigh one joint alone, with one sign; then all joints, with signs that change more and more often.
    """
    if number < joints:
        return np.tile(np.arange(joints) == number, (times, 1)).astype(float)
    random = np.random.default_rng(number)
    phase = np.linspace(0.0, 1.0, times)[:, None] * (number // joints) + random.uniform(size=joints)
    return random.normal(size=joints) * np.cos(np.pi * phase)
