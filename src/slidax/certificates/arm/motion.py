"""The scenario's motion, what its law believes along it, and which torque it lacks for a true arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax._types import State
from slidax.adaptation.believed import with_rotors
from slidax.controllers import SampledData
from slidax.robots import AbstractRobot, Articulated
from slidax.scenarios import Scenario
from slidax.simulation import Plant

from .evaluated import Floats, friction, mass_and_bias, pushed, unloaded


@dataclass(frozen=True, eq=False)
class Belief:
    """The arm as a law believes it to be at first: `M̂ = S (M0 + diag(J - J0)) S` and `F̂ = f tanh(q̇_d/v_s)`.

    - `robot`: M0, C0 and G0.
    - `rotor`, `counted`: J, and J0 [n]; None for a law that learns nothing, where `M̂ = M0`.
    - `coulomb`, `smoothing`: f, and v_s [n].
    - `like`: an arm whose machine code may do for this one.
    - `times`: since when each J and f, [K n], are believed [K], s; None where they are [n] and do not change.
    """

    robot: AbstractRobot
    rotor: Floats | None
    counted: Floats | None
    coulomb: Floats
    smoothing: Floats
    like: Plant
    times: Floats | None = None

    @classmethod
    def of(cls, scenario: Scenario, like: Plant) -> Belief:
        """What a scenario's law believes before it has learnt anything.

        - `scenario`: whose.
        - `like`: an arm whose machine code may do for this one.

        Raises DefinitionError for a law without a model.
        """
        law: Any = scenario.controller
        robot = getattr(law, "nominal", None)
        if not isinstance(robot, AbstractRobot):
            raise DefinitionError(f"`{scenario.scheme}` has no model of the arm, so that nothing is asked of it")
        n = robot.joints
        adaptation = law.adaptation if isinstance(law, SampledData) else None
        if adaptation is None:
            return cls(robot, None, None, np.zeros(n), np.ones(n), like)
        learnt = adaptation.learnt(adaptation.init(State(q=jnp.zeros(n), dq=jnp.zeros(n))))
        rotor, counted, coulomb, smoothing = (
            np.broadcast_to(np.asarray(one, float), n)
            for one in (learnt.rotor, adaptation.counted, learnt.coulomb, adaptation.smoothing)
        )
        return cls(robot, rotor, counted, coulomb, smoothing, like)

    def friction(self, t: Floats, dq: Floats) -> Floats:
        """F̂ [N n], N m or N, at the reference's velocities.

        - `t`: times [N], s.
        - `dq`: these velocities [N n].
        """
        return self._then(self.coulomb, t) * np.tanh(dq / self.smoothing)

    def rotor_at(self, t: Floats) -> Floats:
        """J at times [N n]; zero for a law that learns nothing.

        - `t`: times [N], s.
        """
        if self.rotor is None:
            return np.zeros((len(t), len(self.coulomb)))
        return np.array(np.broadcast_to(self._then(self.rotor, t), (len(t), self.rotor.shape[-1])))

    def _then(self, values: Floats, t: Floats) -> Floats:
        if self.times is None:
            return values
        return values[np.clip(np.searchsorted(self.times, t + 1e-9) - 1, 0, len(self.times) - 1)]

    def mass_and_bias(self, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """M̂ [N n n] and C0 q̇ + G0 [N n].

        - `t`: times [N], s.
        - `q`, `dq`: positions and velocities [N n].
        """
        mass, bias = self.at_first(t, q, dq)
        return self.learnt(mass, t), bias

    def at_first(self, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """M0 [N n n], and C0 q̇ + G0 [N n]: the same for all that is learnt of one arm.

        - `t`: times [N], s.
        - `q`, `dq`: positions and velocities [N n].
        """
        return mass_and_bias(self.robot, unloaded(self.robot, self.like), t, q, dq)

    def learnt(self, mass: Floats, t: Floats) -> Floats:
        """M̂ [N n n].

        - `mass`: M0 [N n n].
        - `t`: times [N], s.
        """
        if self.rotor is None:
            return mass
        assert self.counted is not None
        rotor = np.broadcast_to(self._then(self.rotor, t), mass.shape[:2])
        if (rotor >= 0).all():
            return mass + (rotor - self.counted)[:, :, None] * np.eye(mass.shape[1])
        # A few sizes, so that little is compiled anew.
        size = 1 << (len(mass) - 1).bit_length()
        given = (np.resize(one, (size, *one.shape[1:])) for one in (mass, rotor))
        return np.asarray(_with_rotors(*given, self.counted))[: len(mass)]


@jax.jit
def _with_rotors(mass: Any, rotor: Any, counted: Any) -> Any:
    return jax.vmap(with_rotors, in_axes=(0, 0, None))(mass, rotor, counted)


@dataclass(frozen=True, eq=False)
class Motion:
    """States at times, with the acceleration that the law asks for there.

    - `t`: times [N], s.
    - `q`, `dq`, `ddq`: positions, velocities, and the mean acceleration over the period that begins [N n].
    - `wanted`: the reference's velocities, where they are others [N n].
    """

    t: Floats
    q: Floats
    dq: Floats
    ddq: Floats
    wanted: Floats | None = None

    @property
    def wanted_dq(self) -> Floats:
        """The reference's velocities [N n], at which a law compensates friction."""
        return self.dq if self.wanted is None else self.wanted

    @classmethod
    def of(cls, scenario: Scenario) -> Motion:
        """The scenario's reference at each sample from the start to its end.

        - `scenario`: whose.
        """
        h, n = scenario.period, round(scenario.t1 / scenario.period)
        t = h * np.arange(max(n, 1) + 1)
        reference = _reference(scenario.trajectory, jnp.asarray(t))
        q, dq = np.asarray(reference.q), np.asarray(reference.dq)
        return cls(t[:-1], q[:-1], dq[:-1], np.diff(dq, axis=0) / h)

    def beside(self, q: Floats, dq: Floats) -> Motion:
        """The same at other states.

        - `q`, `dq`: how far beside, [n] or [N n].
        """
        return Motion(self.t, self.q + q, self.dq + dq, self.ddq, self.wanted_dq)

    def every(self, instants: int) -> Motion:
        """Some of the states, equally far apart.

        - `instants`: about how many.
        """
        step = max(1, len(self.t) // instants)
        wanted = self.wanted_dq[::step]
        return Motion(self.t[::step], self.q[::step], self.dq[::step], self.ddq[::step], wanted)

    def at(self, times: Floats, instants: int) -> Motion:
        """States at some times, each being that of the period it is in, and those of other samples.

        The others are spread by the golden ratio, since what repeats would be seen at one phase if they were even.

        - `times`: [K], s.
        - `instants`: how many others.
        """
        count = len(self.t)
        spread = np.sort((np.arange(min(instants, count)) * 0.618033988749895) % 1.0 * count).astype(int)
        own = np.searchsorted(self.t, times, side="right") - 1
        which = np.concatenate([spread, np.clip(own, 0, count - 1)])
        t = np.concatenate([self.t[spread], times])
        return Motion(t, self.q[which], self.dq[which], self.ddq[which], self.wanted_dq[which])

    @cached_property
    def joints(self) -> int:
        """How many there are."""
        return int(self.q.shape[1])


@eqx.filter_jit
def _reference(trajectory: Any, t: Any) -> Any:
    return jax.vmap(trajectory.reference)(t)


def kinds_of(plants: list[Plant]) -> tuple[list[Plant], list[int]]:
    """One arm of each inertia, and the number of each arm's kind: those that differ in friction or forces are alike.

    - `plants`: P arms.
    """
    keys: dict[Any, int] = {}
    kinds: list[Plant] = []
    which: list[int] = []
    for plant in plants:
        key = _inertial_key(plant)
        if key not in keys:
            keys[key] = len(kinds)
            kinds.append(plant)
        which.append(keys[key])
    return kinds, which


def needed(plants: list[Plant], motion: Motion) -> tuple[Floats, Floats]:
    """M [P N n n], and `M q̈ + C q̇ + G` without friction and outer forces [P N n], of true arms along a motion.

    - `plants`: P arms.
    - `motion`: N states.
    """
    found = [mass_and_bias(plant.robot, plant.load, motion.t, motion.q, motion.dq) for plant in plants]
    masses = np.array([mass for mass, _ in found])
    return masses, np.einsum("pkij,kj->pki", masses, motion.ddq) + np.array([bias for _, bias in found])


def outer(plants: list[Plant], motion: Motion) -> Floats:
    """`τ_d - F` of true arms along a motion [P N n], N m or N.

    - `plants`: P arms.
    - `motion`: N states.
    """
    return disturbed(plants, motion) - np.array([friction(plant.robot, motion.dq) for plant in plants])


def disturbed(plants: list[Plant], motion: Motion) -> Floats:
    """`τ_d` of true arms along a motion [P N n], N m or N.

    - `plants`: P arms.
    - `motion`: N states.
    """
    done: dict[Any, Floats] = {}
    found = []
    for plant in plants:
        key = _key(plant.disturbance)
        if key not in done:
            done[key] = pushed(plant, motion.t, motion.q, motion.dq)
        found.append(done[key])
    return np.array(found)


def breakpoints(plants: Sequence[Plant], end: float) -> Floats:
    """Times at which a force or a payload of some arms sets in, jumps or ends, up to the end of the run [K], s.

    - `plants`: the arms.
    - `end`: of the run [s].
    """
    found: set[float] = set()
    for plant in plants:
        found.update(plant.disturbance.breakpoints())
        if plant.load is not None:
            found.update((float(plant.load.attached), float(plant.load.released)))
    return np.array(sorted(time for time in found if 0.0 <= time <= end))


def _inertial_key(plant: Plant) -> Any:
    robot = plant.robot
    if isinstance(robot, Articulated):
        nothing = np.zeros(robot.joints)
        robot = eqx.tree_at(lambda arm: (arm.coulomb, arm.viscous), robot, (nothing, nothing))
    return _key((robot, plant.load))


def _key(tree: Any) -> Any:
    leaves, structure = jax.tree.flatten(tree)
    return structure, tuple(np.asarray(leaf).tobytes() for leaf in leaves)
