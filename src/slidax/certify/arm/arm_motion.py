"""Inertia, friction and external torques of true and nominal arms along a motion, and the ratio of their inertias.

Arms of the same structure share compiled code, since the arms' values are inputs of that code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.mismatch import TimedPayload
from slidax.codegen import llvm
from slidax.codegen.ir import NoNativeCodeError
from slidax.codegen.trace.tracing import trace
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law.adaptation import with_rotors
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from ..sampled_scenario import Floats

BLOCK = 65536
"""States per block; their inertia matrices take 25 MB for seven joints."""

_kernels: dict[Any, Callable[..., tuple[Floats, Floats]]] = {}


def mass_and_bias(
    robot: AbstractRobot, load: TimedPayload | None, t: Floats, q: Floats, dq: Floats
) -> tuple[Floats, Floats]:
    """Return the inertia `M(q)` [times n n] and the bias `C(q,q̇) q̇ + G(q)` [times n] of an arm, in SI units.

    - `load`: the payload with the times at which it is attached and released, or None.
    - `t`: [times], s. `q`, `dq`: positions and velocities [times n].
    """
    arrays, rest = eqx.partition((robot, load), eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    leaves = [np.asarray(leaf, float) for leaf in leaves]
    key = tree, tuple(leaf.shape for leaf in leaves), str(rest)
    if key not in _kernels:
        _kernels[key] = _kernel(leaves, tree, rest, robot.joints)
    blocks = [
        _kernels[key](t[k : k + BLOCK], q[k : k + BLOCK], dq[k : k + BLOCK], leaves) for k in range(0, len(t), BLOCK)
    ]
    return np.concatenate([mass for mass, _ in blocks]), np.concatenate([bias for _, bias in blocks])


def _kernel(leaves: list[Floats], tree: Any, rest: Any, joints: int) -> Callable[..., tuple[Floats, Floats]]:
    def at(t: Any, q: Any, dq: Any, *leaves: Any) -> Any:
        robot, load = eqx.combine(jax.tree.unflatten(tree, list(leaves)), rest)
        carrying = robot if load is None else load.on(robot, t)
        return carrying.mass(q), carrying.bias(q, dq)

    if llvm.available():
        with suppress(NoNativeCodeError):
            number, joint = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((joints,), float)
            shapes = [jax.ShapeDtypeStruct(leaf.shape, float) for leaf in leaves]
            program = trace(at, number, joint, joint, *shapes, named=False)
            program.inputs[:] = [replace(source, varying=k < 3) for k, source in enumerate(program.inputs)]
            kernel = llvm.compile(program)

            def native(t: Floats, q: Floats, dq: Floats, leaves: list[Floats]) -> tuple[Floats, Floats]:
                mass, bias = kernel.batch([t, q, dq, *leaves], runs=len(t))
                return mass, bias

            return native
    compiled = jax.jit(jax.vmap(at, in_axes=(0, 0, 0, *[None] * len(leaves))))

    def plain(t: Floats, q: Floats, dq: Floats, leaves: list[Floats]) -> tuple[Floats, Floats]:
        mass, bias = compiled(t, q, dq, *leaves)
        return np.asarray(mass), np.asarray(bias)

    return plain


def massless_load(robot: AbstractRobot, like: Plant) -> TimedPayload | None:
    """Return a payload of mass 0, or None.

    With it, a robot without payload has the structure of the plant `like`, and can use the code compiled for that
    plant. None if the two robots differ in structure, or `like` has no payload.
    """
    alike = bool(jax.tree.structure(robot) == jax.tree.structure(like.robot))  # type: ignore[operator]
    if like.load is None or not alike:
        return None
    return eqx.tree_at(lambda load: load.payload, like.load, like.load.payload.times(jnp.zeros(())))


def friction_torque(robot: AbstractRobot, dq: Floats) -> Floats:
    """Return the arm's friction torque F(q̇) [times n], N m or N."""
    if isinstance(robot, Articulated):
        coulomb, viscous, smoothing = (np.asarray(x) for x in (robot.coulomb, robot.viscous, robot.smoothing))
        return coulomb * np.tanh(dq / smoothing) + viscous * dq
    return np.asarray(_friction(robot, jnp.asarray(dq)))


def external_torque(plant: Plant, t: Floats, q: Floats, dq: Floats) -> Floats:
    """Return the external torque `τ_d` [times n], N m or N."""
    return np.asarray(_external_torques(plant.disturbance, jnp.asarray(t), jnp.asarray(q), jnp.asarray(dq)))


@eqx.filter_jit
def _friction(robot: AbstractRobot, dq: Any) -> Any:
    return jax.vmap(robot.friction)(dq)


@eqx.filter_jit
def _external_torques(disturbance: Any, t: Any, q: Any, dq: Any) -> Any:
    return jax.vmap(lambda t, q, dq: disturbance(t, State(q=q, dq=dq)))(t, q, dq)


@dataclass(frozen=True, eq=False)
class NominalModel:
    """A law's model of the arm: inertia `M̂ = S (M0 + diag(max(J, 0) - J0)) S`, friction `F̂ = f tanh(q̇_d/v_s)`.

    J are the rotor inertias that the law has learned, and J0 those that M0 contains. S is the identity, or a diagonal
    scaling if a J is below 0 (`with_rotors`).

    - `robot`: the nominal arm, with the inertia M0, Coriolis matrix C0 and gravity torque G0.
    - `rotor`, `counted`: J and J0 [n]; None for a law that does not learn, where `M̂ = M0`.
    - `coulomb`, `smoothing`: Coulomb friction f, and its velocity scale v_s [n].
    - `like`: an arm whose compiled code the model may use.
    - `times`: times [K], s, from which on each row of J and f [K n] is used; None if J and f are constant [n].
    """

    robot: AbstractRobot
    rotor: Floats | None
    counted: Floats | None
    coulomb: Floats
    smoothing: Floats
    like: Plant
    times: Floats | None = None

    @classmethod
    def of(cls, scenario: Scenario, like: Plant) -> NominalModel:
        """Return the initial model of a scenario's law.

        - `like`: an arm whose compiled code the model may use.

        Raises DefinitionError for a law without a model.
        """
        law: Any = scenario.controller
        robot = getattr(law, "nominal", None)
        if not isinstance(robot, AbstractRobot):
            raise DefinitionError(
                f"`{scenario.scheme}` has no model of the arm, so the disturbances that it must compensate cannot be "
                "computed"
            )
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
        """Return the model's friction F̂ [times n], N m or N.

        - `t`: [times], s. `dq`: velocities of the reference [times n].
        """
        return self._value_at(self.coulomb, t) * np.tanh(dq / self.smoothing)

    def _value_at(self, values: Floats, t: Floats) -> Floats:
        if self.times is None:
            return values
        return values[np.clip(np.searchsorted(self.times, t + 1e-9) - 1, 0, len(self.times) - 1)]

    def mass_and_bias(self, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """Return the model's inertia M̂ [times n n] and `C0 q̇ + G0` [times n]."""
        mass, bias = self.at_first(t, q, dq)
        return self.learnt(mass, t), bias

    def at_first(self, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """Return M0 [times n n] and `C0 q̇ + G0` [times n], the model without learned values."""
        return mass_and_bias(self.robot, massless_load(self.robot, self.like), t, q, dq)

    def learnt(self, mass: Floats, t: Floats) -> Floats:
        """Return M̂ [times n n]: M0 with the rotor inertias that the law has learned at these times.

        - `mass`: M0 [times n n]. `t`: [times], s.
        """
        if self.rotor is None:
            return mass
        assert self.counted is not None
        rotor = np.broadcast_to(self._value_at(self.rotor, t), mass.shape[:2])
        if (rotor >= 0).all():
            return mass + (rotor - self.counted)[:, :, None] * np.eye(mass.shape[1])
        # The batch is padded to a power of two, so that only few sizes are compiled.
        size = 1 << (len(mass) - 1).bit_length()
        filled = (np.resize(values, (size, *values.shape[1:])) for values in (mass, rotor))
        return np.asarray(_with_rotors(*filled, self.counted))[: len(mass)]


@jax.jit
def _with_rotors(mass: Any, rotor: Any, counted: Any) -> Any:
    return jax.vmap(with_rotors, in_axes=(0, 0, None))(mass, rotor, counted)


@dataclass(frozen=True, eq=False)
class StateSequence:
    """States of the reference over time, each with the acceleration that the law feeds forward.

    - `t`: [times], s.
    - `q`, `dq`, `ddq`: positions, velocities, and the mean acceleration over the period from that time on [times n].
    """

    t: Floats
    q: Floats
    dq: Floats
    ddq: Floats

    @classmethod
    def of(cls, scenario: Scenario) -> StateSequence:
        """Return the scenario's reference at each sample of the run."""
        h, n = scenario.period, round(scenario.t1 / scenario.period)
        t = h * np.arange(max(n, 1) + 1)
        reference = _reference(scenario.trajectory, jnp.asarray(t))
        q, dq = np.asarray(reference.q), np.asarray(reference.dq)
        return cls(t[:-1], q[:-1], dq[:-1], np.diff(dq, axis=0) / h)

    def every(self, instants: int) -> StateSequence:
        """Return about `instants` of the states, evenly spaced."""
        step = max(1, len(self.t) // instants)
        return StateSequence(self.t[::step], self.q[::step], self.dq[::step], self.ddq[::step])

    def at(self, times: Floats, instants: int) -> StateSequence:
        """Return the states at up to `instants` samples, followed by the states at `times`.

        A time between two samples has the state of the sample before. The samples are spread by the golden ratio:
        evenly spaced samples could meet a periodic motion at a single phase.
        """
        count = len(self.t)
        spread = np.sort((np.arange(min(instants, count)) * 0.618033988749895) % 1.0 * count).astype(int)
        periods = np.searchsorted(self.t, times, side="right") - 1
        rows = np.concatenate([spread, np.clip(periods, 0, count - 1)])
        t = np.concatenate([self.t[spread], times])
        return StateSequence(t, self.q[rows], self.dq[rows], self.ddq[rows])

    @cached_property
    def joints(self) -> int:
        """Number of joints n."""
        return int(self.q.shape[1])


@eqx.filter_jit
def _reference(trajectory: Any, t: Any) -> Any:
    return jax.vmap(trajectory.reference)(t)


def distinct_inertias(plants: list[Plant]) -> tuple[list[Plant], list[int]]:
    """Return one arm for each distinct inertia, and for each of `plants` the index of its inertia's arm.

    Arms that differ only in friction or external forces have the same inertia.
    """
    keys: dict[Any, int] = {}
    distinct: list[Plant] = []
    indices: list[int] = []
    for plant in plants:
        key = _inertial_key(plant)
        if key not in keys:
            keys[key] = len(distinct)
            distinct.append(plant)
        indices.append(keys[key])
    return distinct, indices


def rigid_body_torque(plants: list[Plant], motion: StateSequence) -> tuple[Floats, Floats]:
    """Return inertia M [arms samples n n] and torque `M q̈ + C q̇ + G` [arms samples n] of true arms along a motion."""
    torques = [mass_and_bias(plant.robot, plant.load, motion.t, motion.q, motion.dq) for plant in plants]
    masses = np.array([mass for mass, _ in torques])
    return masses, np.einsum("pkij,kj->pki", masses, motion.ddq) + np.array([bias for _, bias in torques])


def outer_torque(plants: list[Plant], motion: StateSequence) -> Floats:
    """Return external torque less friction, `τ_d - F`, of true arms along a motion [arms samples n], N m or N."""
    return disturbance_torque(plants, motion) - np.array([friction_torque(plant.robot, motion.dq) for plant in plants])


def disturbance_torque(plants: list[Plant], motion: StateSequence) -> Floats:
    """Return the external torque τ_d on true arms along a motion [arms samples n], N m or N."""
    known: dict[Any, Floats] = {}
    torques = []
    for plant in plants:
        key = _key(plant.disturbance)
        if key not in known:
            known[key] = external_torque(plant, motion.t, motion.q, motion.dq)
        torques.append(known[key])
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
        zero = np.zeros(robot.joints)
        robot = eqx.tree_at(lambda arm: (arm.coulomb, arm.viscous), robot, (zero, zero))
    return _key((robot, plant.load))


def _key(tree: Any) -> Any:
    leaves, structure = jax.tree.flatten(tree)
    return structure, tuple(np.asarray(leaf).tobytes() for leaf in leaves)


INSTANTS = 200
"""Instants of the motion at which ratios are evaluated."""

KEPT = 24
"""Number of these instants at which K of each member is returned."""


def inertia_ratios(
    plants: Sequence[Plant], beliefs: Sequence[NominalModel], motion: StateSequence, kept: int = KEPT
) -> tuple[Floats, Floats, Floats]:
    """Return extremes of `K = M⁻¹M̂` over all arms, with the true inertia M and the law's M̂, at `INSTANTS` times.

    The three results are:

    - the least and the largest κ [2 n], where κ is the diagonal of K;
    - the largest |K_ij/K_jj| for i ≠ j [n n];
    - K at some instants [I n n].

    - `plants`: the true arms. `beliefs`: the law's model for each of them.
    - `kept`: number of instants at which K is returned for each arm.
    """
    few = motion.every(INSTANTS)
    matrices: list[Floats] = []
    least = np.full(motion.joints, np.inf)
    most, coupling = -least, np.zeros((motion.joints, motion.joints))
    for plant, belief in zip(plants, beliefs, strict=True):
        nominal, _ = belief.mass_and_bias(few.t, few.q, few.dq)
        ratio = np.linalg.solve(rigid_body_torque([plant], few)[0][0], nominal)
        matrices.append(ratio[:: max(1, len(ratio) // kept)])
        diagonal = np.diagonal(ratio, axis1=1, axis2=2)
        least, most = np.minimum(least, diagonal.min(axis=0)), np.maximum(most, diagonal.max(axis=0))
        coupling = np.maximum(coupling, np.abs(ratio / diagonal[:, None, :]).max(axis=0))
    np.fill_diagonal(coupling, 0.0)
    return np.array([least, most]), coupling, np.concatenate(matrices)
