"""A sampling period of a closed loop as a differentiable map of its states and of injected signals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from slidax.codegen.ir import NoNativeCodeError
from slidax.codegen.llvm.kernel import compile
from slidax.codegen.trace.tracing import trace
from slidax.core.parameter import parameter, piece
from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.law.controllers import AbstractController
from slidax.law.sampled.controller import SampledData
from slidax.motions.trajectory import AbstractMotion
from slidax.plant.disturbances import AbstractDisturbance
from slidax.plant.sensors import AbstractSensor, Measurement
from slidax.simulation.loop import Carry, ClosedLoop, sample

LAW_TORQUE = "command of the law"
"""Name of the log's signal with the law's own torque, without the injected torque."""


class InjectedSignals(eqx.Module):
    """Signals injected in a sampling period, each [n].

    - `disturbance`: torque on the joints, held over the period, N m or N.
    - `torque`: added to the law's command, before the drives, N m or N.
    - `reference`, `reference_velocity`, `reference_acceleration`: added to the reference trajectory.
    - `position`, `velocity`: added to the state before the sensor.
    """

    disturbance: Vector
    torque: Vector
    reference: Vector
    reference_velocity: Vector
    reference_acceleration: Vector
    position: Vector
    velocity: Vector


class AddedDisturbance(AbstractDisturbance):
    """A disturbance plus a constant torque."""

    disturbance: AbstractDisturbance = piece("the loop's disturbance")
    torque: Vector = piece("the added torque")

    def __call__(self, t: Scalar, state: State) -> Vector:
        return self.disturbance(t, state) + self.torque

    def breakpoints(self) -> tuple[float, ...]:
        return self.disturbance.breakpoints()


class AddedTorque(AbstractController):
    """A law with a torque added to its command; the law does not know this torque."""

    law: AbstractController = piece("the law")
    torque: Vector = piece("the added torque")

    @property
    def joints(self) -> int:
        return self.law.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        return self.law.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        command = self.law(t, state, reference_now, reference_next, memory)
        return Command(
            command.tau + self.torque, command.memory, {**command.signals, LAW_TORQUE: command.tau}, command.rate
        )

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.law.envelope(t, memory)


class ShiftedSensor(AbstractSensor):
    """A sensor that measures the true state plus a constant offset."""

    sensor: AbstractSensor = piece("the sensor")
    position: Vector = piece("added to the positions")
    velocity: Vector = piece("added to the velocities")

    def init(self, state: State) -> Memory:
        return self.sensor.init(state)

    def __call__(self, k: Array, state: State, period: Scalar, memory: Memory) -> tuple[Measurement, Memory]:
        return self.sensor(k, State(q=state.q + self.position, dq=state.dq + self.velocity), period, memory)


class OffsetMotion(AbstractMotion):
    """A motion with constant offsets of its position, velocity and acceleration; each offset may have any value."""

    motion: AbstractMotion = piece("the motion")
    q: Vector = piece("added to the position")
    dq: Vector = piece("added to the velocity")
    ddq: Vector = piece("added to the acceleration")

    def position(self, t: Scalar) -> Vector:
        return self.motion.position(t) + self.q

    def reference(self, t: Scalar) -> Reference:
        reference = self.motion.reference(t)
        return Reference(q=reference.q + self.q, dq=reference.dq + self.dq, ddq=reference.ddq + self.ddq)


def inject(loop: ClosedLoop, signals: InjectedSignals) -> ClosedLoop:
    """Return a closed loop to which signals are added; the structure of its memory is unchanged.

    - `loop`: the loop; in held mode it must have a sensor.
    - `signals`: the signals, constant over the period.
    """
    plant = eqx.tree_at(
        lambda p: p.disturbance, loop.plant, AddedDisturbance(loop.plant.disturbance, signals.disturbance)
    )
    if plant.sensor is not None:
        plant = eqx.tree_at(lambda p: p.sensor, plant, ShiftedSensor(plant.sensor, signals.position, signals.velocity))
    motion = OffsetMotion(
        loop.trajectory, signals.reference, signals.reference_velocity, signals.reference_acceleration
    )
    law = AddedTorque(loop.controller, signals.torque)
    return eqx.tree_at(lambda x: (x.plant, x.trajectory, x.controller), loop, (plant, motion, law))


def freeze_adaptation(controller: AbstractController, memory: Memory) -> tuple[AbstractController, Memory]:
    """Return the law with its learnt parameters frozen, and its memory without the state of the learning."""
    if not isinstance(controller, SampledData) or controller.adaptation is None:
        return controller, memory
    adaptation = controller.adaptation
    known = adaptation.frozen(memory.adapted.memory)
    law: AbstractController = eqx.tree_at(lambda law: law.adaptation, controller, known)
    nothing = jnp.zeros_like(memory.prior.state.q)
    return law, eqx.tree_at(lambda kept: kept.adapted.memory, memory, nothing)


class DelayLineMemory(eqx.Module):
    """The memory of `DelayLine`.

    - `q`, `dq`: the last m states [m n], the newest first.
    - `inner`: the memory of the delayed sensor.
    """

    q: Float[Array, "m n"]
    dq: Float[Array, "m n"]
    inner: Memory


class DelayLine(AbstractSensor):
    """`slidax.plant.Delayed` without jitter, as a shift register.

    `Delayed` keeps the states in a ring buffer, whose index changes in each period: the period is then not
    a time-invariant map. In the shift register the newest state always comes first.
    """

    sensor: AbstractSensor = piece("the delayed sensor")
    periods: float = parameter("the delay, integer or fractional", "sampling periods", "[0, 100]", static=True)

    def init(self, state: State) -> DelayLineMemory:
        shape = (math.ceil(self.periods) + 1, *state.q.shape)
        return DelayLineMemory(
            jnp.broadcast_to(state.q, shape), jnp.broadcast_to(state.dq, shape), self.sensor.init(state)
        )

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: DelayLineMemory
    ) -> tuple[Measurement, DelayLineMemory]:
        q, dq = (jnp.concatenate([new[None], old[:-1]]) for new, old in ((state.q, memory.q), (state.dq, memory.dq)))
        integer, fraction = math.floor(self.periods), self.periods % 1.0
        past = State(q=q[integer], dq=dq[integer])
        if fraction:
            q1, v1, v0 = q[integer], dq[integer], dq[integer + 1]
            mean = (q1 - q[integer + 1]) / period
            square, cube = 2.0 * v1 + v0 - 3.0 * mean, 2.0 * mean - v1 - v0
            past = State(
                q=q1 + period * fraction * (fraction * (square + fraction * cube) - v1),
                dq=v1 - fraction * (2.0 * square + 3.0 * fraction * cube),
            )
        past = jax.tree.map(jnp.asarray, past)
        measurement, inner = self.sensor(k, past, period, memory.inner)
        return measurement, DelayLineMemory(q=q, dq=dq, inner=inner)


INPUTS = tuple(InjectedSignals.__annotations__)
OUTPUTS = ("error", "torque", "position", "velocity")
"""Outputs of the map at the sample: position error, the law's command, and true position and velocity."""


@dataclass(frozen=True, eq=False)
class PeriodMap:
    """The map `x⁺, y = f(x, u)` of a sampling period: x is the loop's state, u the injected signals, y the outputs.

    - `x`: the m states at the operating point [m].
    - `inputs`: size of u, n for each of `INPUTS`.
    - `outputs`: size of y, n for each of `OUTPUTS`.
    - `evaluate`: from (x, u) and a direction, each [m + inputs], to (x⁺, y) and its derivative in this direction, each
      [m + outputs].
    """

    x: np.ndarray
    inputs: int
    outputs: int
    evaluate: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

    def derivative(self) -> np.ndarray:
        """The Jacobian of (x⁺, y) by (x, u) at the operating point and u = 0, [m + outputs, m + inputs]."""
        here = np.concatenate([self.x, np.zeros(self.inputs)])
        return np.stack([self.evaluate(here, direction)[1] for direction in np.eye(here.size)], axis=1)

    def differences(self, steps: np.ndarray) -> np.ndarray:
        """The Jacobian as in `derivative`, by central differences.

        - `steps`: step along each entry of (x, u) [m + inputs].
        """
        here = np.concatenate([self.x, np.zeros(self.inputs)])
        nothing = np.zeros_like(here)
        columns = []
        for k, step in enumerate(steps):
            ends = []
            for side in (step, -step):
                there = here.copy()
                there[k] += side
                ends.append(self.evaluate(there, nothing)[0])
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        return np.stack(columns, axis=1)


def period_map(loop: ClosedLoop, carry: Carry) -> PeriodMap:
    """Return the map of a loop over a sampling period, with its learning frozen.

    - `carry`: state of the loop before the sample.
    """
    controller, memory = freeze_adaptation(loop.controller, carry.memory)
    loop = eqx.tree_at(lambda x: x.controller, loop, controller)
    carry = eqx.tree_at(lambda c: c.memory, carry, memory)
    # Only the state that affects later samples: no statistics.
    moving = (carry.state, carry.memory, carry.sensor, carry.actuator, carry.torque)
    floats, others = eqx.partition(moving, eqx.is_inexact_array)
    x, unravel = ravel_pytree(floats)
    n = carry.state.q.size
    inputs = len(INPUTS) * n

    arrays, rest = eqx.partition((loop, others, carry), eqx.is_array)

    def after(arrays: Any, xu: jax.Array) -> jax.Array:
        loop, others, carry = eqx.combine(arrays, rest)
        state, memory, sensor, actuator, torque = eqx.combine(unravel(xu[: x.size]), others)
        signals = InjectedSignals(*(xu[x.size :].reshape(len(INPUTS), n)))
        before = eqx.tree_at(
            lambda c: (c.state, c.memory, c.sensor, c.actuator, c.torque),
            carry,
            (state, memory, sensor, actuator, torque),
            is_leaf=lambda leaf: leaf is None,
        )
        loop = inject(loop, signals)
        then, log = sample(loop, before)
        kept = (then.state, then.memory, then.sensor, then.actuator, then.torque)
        moved = ravel_pytree(eqx.filter(kept, eqx.is_inexact_array))[0]
        y = [log.e, log.signals[LAW_TORQUE], state.q, state.dq]
        return jnp.concatenate([moved, *y])

    def with_slope(arrays: Any, xu: jax.Array, direction: jax.Array) -> tuple[jax.Array, jax.Array]:
        value, slope = jax.jvp(lambda xu: after(arrays, xu), (xu,), (direction,))
        return value, slope

    return PeriodMap(
        x=np.asarray(x),
        inputs=inputs,
        outputs=len(OUTPUTS) * n,
        evaluate=_compiled(with_slope, arrays, x.size + inputs),
    )


def _compiled(
    function: Any, arrays: Any, size: int
) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Compile a function to machine code within seconds, or by XLA if this is not possible."""
    known = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays)]
    shapes = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), arrays)
    numbers = jax.ShapeDtypeStruct((size,), float)
    try:
        kernel = compile(trace(function, shapes, numbers, numbers, named=False))
    except (NoNativeCodeError, ImportError):
        jitted = jax.jit(function)

        def by_xla(xu: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value, slope = jitted(arrays, jnp.asarray(xu), jnp.asarray(direction))
            return np.asarray(value), np.asarray(slope)

        return by_xla

    def natively(xu: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = kernel([*known, xu, direction])
        return value, slope

    return natively
