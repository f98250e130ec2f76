"""A scenario's motion, its law's nominal model along the motion, and the torque that the model lacks for a true arm."""

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

from ..each import Floats
from .evaluated import friction, mass_and_bias, pushed, unloaded


@dataclass(frozen=True, eq=False)
class Belief:
    """A law's model of the arm: `M̂ = S (M0 + diag(J - J0)) S` and `F̂ = f tanh(q̇_d/v_s)`.

    - `robot`: M0, C0 and G0.
    - `rotor`, `counted`: J, and J0 [n]; None for a law that does not learn, where `M̂ = M0`.
    - `coulomb`, `smoothing`: f, and v_s [n].
    - `like`: an arm whose machine code this one may share.
    - `times`: times [K], s, from which on each J and f [K n] is used; None for constant ones [n].
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
        """Return the model that a scenario's law starts with.

        - `like`: an arm whose machine code the model may share.

        Raises DefinitionError for a law without a model.
        """
        law: Any = scenario.controller
        robot = getattr(law, "nominal", None)
        if not isinstance(robot, AbstractRobot):
            raise DefinitionError(f"`{scenario.scheme}` has no model of the arm: its demand cannot be computed")
        n = robot.joints
        adaptation = law.adaptation if isinstance(law, SampledData) else None
        if adaptation is None:
            return cls(robot, None, None, np.zeros(n), np.ones(n), like)
        learnt = adaptation.learnt(adaptation.init(State(q=jnp.zeros(n), dq=jnp.zeros(n))))
        rotor, counted, coulomb, smoothing = (
            np.broadcast_to(np.asarray(value, float), n)
            for value in (learnt.rotor, adaptation.counted, learnt.coulomb, adaptation.smoothing)
        )
        return cls(robot, rotor, counted, coulomb, smoothing, like)

    def friction(self, t: Floats, dq: Floats) -> Floats:
        """F̂ [N n], N m or N, at times [N], s, and the reference's velocities [N n]."""
        return self._then(self.coulomb, t) * np.tanh(dq / self.smoothing)

    def rotor_at(self, t: Floats) -> Floats:
        """J at times [N n]; zero for a law that does not learn."""
        if self.rotor is None:
            return np.zeros((len(t), len(self.coulomb)))
        return np.array(np.broadcast_to(self._then(self.rotor, t), (len(t), self.rotor.shape[-1])))

    def _then(self, values: Floats, t: Floats) -> Floats:
        if self.times is None:
            return values
        return values[np.clip(np.searchsorted(self.times, t + 1e-9) - 1, 0, len(self.times) - 1)]

    def mass_and_bias(self, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """M̂ [N n n] and C0 q̇ + G0 [N n]."""
        mass, bias = self.at_first(t, q, dq)
        return self.learnt(mass, t), bias

    def at_first(self, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """M0 [N n n], and C0 q̇ + G0 [N n], which do not depend on learned values."""
        return mass_and_bias(self.robot, unloaded(self.robot, self.like), t, q, dq)

    def learnt(self, mass: Floats, t: Floats) -> Floats:
        """M̂ [N n n] from M0 [N n n] at times [N], s."""
        if self.rotor is None:
            return mass
        assert self.counted is not None
        rotor = np.broadcast_to(self._then(self.rotor, t), mass.shape[:2])
        if (rotor >= 0).all():
            return mass + (rotor - self.counted)[:, :, None] * np.eye(mass.shape[1])
        # Powers of two, so that few sizes are compiled.
        size = 1 << (len(mass) - 1).bit_length()
        filled = (np.resize(values, (size, *values.shape[1:])) for values in (mass, rotor))
        return np.asarray(_with_rotors(*filled, self.counted))[: len(mass)]


@jax.jit
def _with_rotors(mass: Any, rotor: Any, counted: Any) -> Any:
    return jax.vmap(with_rotors, in_axes=(0, 0, None))(mass, rotor, counted)


@dataclass(frozen=True, eq=False)
class Motion:
    """States at times, with the acceleration that the law needs there.

    - `t`: [N], s.
    - `q`, `dq`, `ddq`: positions, velocities, and the mean acceleration over the period that begins there [N n].
    - `wanted`: velocities of the reference [N n], if they differ from `dq`.
    """

    t: Floats
    q: Floats
    dq: Floats
    ddq: Floats
    wanted: Floats | None = None

    @property
    def wanted_dq(self) -> Floats:
        """Velocities of the reference [N n], at which a law compensates friction."""
        return self.dq if self.wanted is None else self.wanted

    @classmethod
    def of(cls, scenario: Scenario) -> Motion:
        """The scenario's reference at each sample from the start to its end."""
        h, n = scenario.period, round(scenario.t1 / scenario.period)
        t = h * np.arange(max(n, 1) + 1)
        reference = _reference(scenario.trajectory, jnp.asarray(t))
        q, dq = np.asarray(reference.q), np.asarray(reference.dq)
        return cls(t[:-1], q[:-1], dq[:-1], np.diff(dq, axis=0) / h)

    def shifted(self, q: Floats, dq: Floats) -> Motion:
        """The motion with states that deviate by `q` and `dq`, [n] or [N n]."""
        return Motion(self.t, self.q + q, self.dq + dq, self.ddq, self.wanted_dq)

    def every(self, instants: int) -> Motion:
        """About `instants` of the states, evenly spaced."""
        step = max(1, len(self.t) // instants)
        wanted = self.wanted_dq[::step]
        return Motion(self.t[::step], self.q[::step], self.dq[::step], self.ddq[::step], wanted)

    def at(self, times: Floats, instants: int) -> Motion:
        """States at given times, each with the state of its period, and at `instants` other samples.

        The other samples are spread by the golden ratio: evenly spaced ones would see a repeating motion at one phase.
        """
        count = len(self.t)
        spread = np.sort((np.arange(min(instants, count)) * 0.618033988749895) % 1.0 * count).astype(int)
        own = np.searchsorted(self.t, times, side="right") - 1
        which = np.concatenate([spread, np.clip(own, 0, count - 1)])
        t = np.concatenate([self.t[spread], times])
        return Motion(t, self.q[which], self.dq[which], self.ddq[which], self.wanted_dq[which])

    @cached_property
    def joints(self) -> int:
        return int(self.q.shape[1])


@eqx.filter_jit
def _reference(trajectory: Any, t: Any) -> Any:
    return jax.vmap(trajectory.reference)(t)


def kinds_of(plants: list[Plant]) -> tuple[list[Plant], list[int]]:
    """Return one arm of each inertia, and the number of each arm's inertia [P].

    Arms that differ only in friction or forces share an inertia.
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
    """Return M [P N n n], and `M q̈ + C q̇ + G` [P N n], of P true arms along a motion."""
    torques = [mass_and_bias(plant.robot, plant.load, motion.t, motion.q, motion.dq) for plant in plants]
    masses = np.array([mass for mass, _ in torques])
    return masses, np.einsum("pkij,kj->pki", masses, motion.ddq) + np.array([bias for _, bias in torques])


def outer(plants: list[Plant], motion: Motion) -> Floats:
    """Return `τ_d - F` of P true arms along a motion [P N n], N m or N."""
    return disturbed(plants, motion) - np.array([friction(plant.robot, motion.dq) for plant in plants])


def disturbed(plants: list[Plant], motion: Motion) -> Floats:
    """Return `τ_d` of P true arms along a motion [P N n], N m or N."""
    done: dict[Any, Floats] = {}
    torques = []
    for plant in plants:
        key = _key(plant.disturbance)
        if key not in done:
            done[key] = pushed(plant, motion.t, motion.q, motion.dq)
        torques.append(done[key])
    return np.array(torques)


def breakpoints(plants: Sequence[Plant], end: float) -> Floats:
    """Return the times at which a force or a payload starts, jumps or ends, up to the end of the run [K], s."""
    times: set[float] = set()
    for plant in plants:
        times.update(plant.disturbance.breakpoints())
        if plant.load is not None:
            times.update((float(plant.load.attached), float(plant.load.released)))
    return np.array(sorted(time for time in times if 0.0 <= time <= end))


def _inertial_key(plant: Plant) -> Any:
    robot = plant.robot
    if isinstance(robot, Articulated):
        nothing = np.zeros(robot.joints)
        robot = eqx.tree_at(lambda arm: (arm.coulomb, arm.viscous), robot, (nothing, nothing))
    return _key((robot, plant.load))


def _key(tree: Any) -> Any:
    leaves, structure = jax.tree.flatten(tree)
    return structure, tuple(np.asarray(leaf).tobytes() for leaf in leaves)
