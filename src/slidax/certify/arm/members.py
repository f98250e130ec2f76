"""Members of an uncertainty set: the true arms that a scenario allows, each with its external forces."""

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
"""Number of members that are built together."""

MOST_ENDS = 256
"""Largest number of corners up to which all corners are evaluated."""

NAMED = 6
"""Largest number of uncertain values that a sentence lists by name."""

BRIEF = 0.125
"""A force that acts at less than this share of the samples is brief: it may lie between random instants."""

NO_EFFECT = 1e-12
"""Share of the sum of all effects below which an effect is due to rounding."""

INSTANTS = 64
"""Number of instants of the motion at which effects of uncertain values are computed, in addition to jumps."""


@dataclass(frozen=True, eq=False)
class Members:
    """The true arms of a scenario: points of a box with D axes, one for each uncertain value of the arm and its forces.

    - `scenario`: the scenario; all members have its law.
    - `family`: the uncertainty set.
    """

    scenario: Scenario
    family: Family

    @classmethod
    def of(cls, scenario: Scenario, family: Family | None = None) -> Members:
        """Return the members of a scenario's set, or of another set.

        - `family`: another set, such as a study's; None for the scenario's own.

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
        return tuple(axes)

    @cached_property
    def plant(self) -> Plant:
        """The scenario's own arm, with its payload and its external forces."""
        plant = self.scenario.plant
        own = plant if isinstance(plant, Plant) else plant.own
        return Plant(own.robot, own.disturbance, load=own.load)

    def values(self, points: Floats) -> dict[str, Floats]:
        """Return the members' values by path in the scenario file, each [P ...].

        - `points`: points of the box [P D], as shares from 0 to 1.
        """
        values: dict[str, Floats] = {}
        for k, axis in enumerate(self.axes):
            before = values.get(axis.path, np.broadcast_to(axis.lower, (len(points), *axis.lower.shape)))
            values[axis.path] = axis.moved(before, points[:, k])
        return values

    def plants(self, points: Floats) -> list[Plant]:
        """Return the true arms, with their payloads and external forces, but without sensors and drives.

        - `points`: points of the box [P D], as shares from 0 to 1.

        Raises DefinitionError if the values do not define an arm.
        """
        if not self.axes:
            return [self.plant] * len(points)
        values = self.values(np.asarray(points, float))
        try:
            arrays = [
                self._arrays({path: some[k : k + CHUNK] for path, some in values.items()})
                for k in range(0, len(points), CHUNK)
            ]
        except UNTRACEABLE:
            return [self._plant({path: some[k] for path, some in values.items()}) for k in range(len(points))]
        rest = eqx.filter(self._plant({path: some[0] for path, some in values.items()}), eqx.is_array, inverse=True)
        return [
            eqx.combine(jax.tree.map(lambda leaf, k=k: leaf[k], some), rest)
            for some in arrays
            for k in range(len(jax.tree.leaves(some)[0]))
        ]

    def ends(self, without: Sequence[int] = (), most: int = MOST_ENDS) -> Floats:
        """Return the middle of the box, and its corners in all axes that can change the inertia [P D].

        If there are more than `most` corners, only `most` of them are returned: the corners with all values least and
        with all values largest, and corners from `extremes`. All other axes are at their middle.

        - `without`: axes that have no effect and are left at their middle.
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
        """Return the axes that can change the inertia, except those in `without`."""
        return [k for k in range(len(self.axes)) if k not in without and self.is_inertial(k)]

    def extremes(self, count: int) -> Floats:
        """Return corners of the set at which the effects of all values on the torques add up [count D], from 0 to 1.

        A coordinate is a share of the range of one of the D values. Each pair of corners belongs to one weighted sum of
        the joint torques along the motion (`_direction`): to first order, the sum is largest at the first corner and
        smallest at the second, the opposite one. A value without effect on the sum is at its middle, 0.5. The order of
        the values in the file has no influence, nor does a force that is written as several equal terms.
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
        """Change of the torques along the motion from the lower to the upper end of each axis [D times n].

        The change is relative to the largest effect of all axes together on that joint. So it does not depend on the
        number of equal terms by which a force is written.
        """
        count, motion = len(self.axes), StateSequence.of(self.scenario)
        if not count:
            return np.zeros((0, 1, motion.joints))
        points = np.repeat([0.5, 1.0], 2 * count)[:, None] * np.ones(count)
        rows = np.arange(2 * count)
        points[2 * rows, rows % count] = 0.0
        points[2 * rows + 1, rows % count] = 1.0
        plants = self.plants(points)
        few = motion.at(np.union1d(breakpoints(plants, motion.t[-1]), self.brief_force_times), instants=INSTANTS)
        distinct, indices = distinct_inertias(plants)
        torque = rigid_body_torque(distinct, few)[1][indices] - outer_torque(plants, few)
        change, change_at_ends = np.split(torque[1::2] - torque[::2], 2)
        # A factor of a force that is 0 in the middle of the set has an effect only elsewhere.
        idle = np.abs(change).max(axis=(1, 2)) <= NO_EFFECT * np.abs(change).sum(axis=0).max()
        change[idle] = change_at_ends[idle]
        largest = np.abs(change).sum(axis=0).max(axis=0)
        return change / np.maximum(largest, 1e-300)

    @cached_property
    def brief_force_times(self) -> Floats:
        """Sample times at which uncertain values change a brief force, such as a contact, most [K], s.

        Each value of the disturbance is moved from one end of its range to the other. All other values are first at
        their lower ends, then in the middle, then at their upper ends.
        """
        motion, samples = StateSequence.of(self.scenario), [np.zeros(0, int)]
        for axis in self.disturbance_axes:
            points = np.repeat([0.0, 0.5, 1.0], 2)[:, None] * np.ones(len(self.axes))
            points[:, axis] = np.tile([0.0, 1.0], 3)
            torques = disturbance_torque(self.plants(points), motion)
            change = np.abs(torques[1::2] - torques[::2])
            acting = (change > 0.0).any(axis=(0, 2)).mean()
            if 0.0 < acting < BRIEF:
                samples.append(change.argmax(axis=1).ravel())
        return motion.t[np.unique(np.concatenate(samples))]

    @cached_property
    def disturbance_axes(self) -> list[int]:
        """Axes that are values of the disturbance."""
        return [k for k, axis in enumerate(self.axes) if axis.path.startswith("disturbance.")]

    def is_inertial(self, axis: int) -> bool:
        """Return True if the value of an axis can change the inertia."""
        path = self.axes[axis].path
        return path.startswith("robot.") and path.split(".")[-1] not in ("coulomb", "viscous", "gravity_acceleration")

    def named(self, axes: Sequence[int]) -> str:
        """Return the names of some axes for a sentence: at most `NAMED` names, then the number of further ones."""
        names = [self.axes[k].name for k in axes]
        more = len(names) - NAMED
        return ", ".join(names) if more <= 1 else f"{', '.join(names[:NAMED])} and {more} more values"

    @cached_property
    def disturbances(self) -> tuple[AbstractDisturbance, AbstractDisturbance]:
        """Two disturbances: the first has each number at its least value in the set, the second at its largest.

        Each number of the disturbance depends on a single axis, so that it is enough to vary one axis at a time.
        """
        axes = self.disturbance_axes
        points = np.full((2 * len(axes) + 1, len(self.axes)), 0.5)
        for row, axis in enumerate(axes):
            points[2 * row + 1, axis], points[2 * row + 2, axis] = 0.0, 1.0
        disturbances = [plant.disturbance for plant in (*self.plants(points), self.plant)]
        lower, upper = (
            jax.tree.map(lambda *each, end=end: end([np.asarray(leaf) for leaf in each], axis=0), *disturbances)
            for end in (np.min, np.max)
        )
        return lower, upper

    @staticmethod
    def largest_friction(plants: Sequence[Plant]) -> Friction:
        """Return the largest Coulomb friction of some arms' joints, with the least velocity scale of its smoothing."""
        n = plants[0].robot.joints
        arms = [plant.robot for plant in plants if isinstance(plant.robot, Articulated)]
        coulomb = np.max([np.broadcast_to(np.asarray(arm.coulomb), n) for arm in arms] or [np.zeros(n)], axis=0)
        smoothing = np.min([np.broadcast_to(np.asarray(arm.smoothing), n) for arm in arms] or [np.ones(n)], axis=0)
        return Friction(jnp.asarray(coulomb), jnp.zeros(n), jnp.asarray(smoothing))

    def _arrays(self, values: dict[str, Floats]) -> Any:
        """Return the arrays of some members' arms; their first axis is the member."""
        count = len(next(iter(values.values())))
        # All calls have the same size, so that the function is compiled once.
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
    def _middle(self) -> Any:
        """The scenario's description with all uncertain values in the middle of the set."""
        values = self.values(np.full((1, len(self.axes)), 0.5))
        return self.family.case({path: some[0] for path, some in values.items()}).as_it_is()

    def _plant(self, values: dict[str, Any]) -> Plant:
        description = with_values(self._middle, values)
        arms = description.robot.build()
        return Plant(arms.true, description.disturbance.build(), load=arms.load)


def _direction(number: int, times: int, joints: int) -> Floats:
    """Return direction `number`: weights of the joints' torques over time [times joints].

    The first n directions weight a single joint, equally at all times. The next ones weight all joints, with more and
    more sign changes over time.
    """
    if number < joints:
        return np.tile(np.arange(joints) == number, (times, 1)).astype(float)
    random = np.random.default_rng(number)
    phase = np.linspace(0.0, 1.0, times)[:, None] * (number // joints) + random.uniform(size=joints)
    return random.normal(size=joints) * np.cos(np.pi * phase)


CORNERS = 8
"""Number of corners that `corner_scenarios` returns."""


@lru_cache(maxsize=4)
def corner_scenarios(scenario: Scenario) -> Sequence[Scenario]:
    """Return the scenario itself and, if it has uncertain values, `CORNERS` scenarios at corners of its set.

    At these corners the effects of all values on the torques add up (`Members.extremes`).

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
