"""One period in held mode: the law decides once, and its torque is held until the next sample."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax._types import Memory, Scalar, State, Vector
from slidax.numerics import once, select

from .evaluation import Evaluation, checked_evaluation, evaluate
from .loop import Carry, Loop, Memories


class HeldTorque(eqx.Module):
    """Torque command [n], N m or N, of a sample until the next one, with the actuator's memory (None without one)."""

    tau: Vector
    delivery: Memory


def evaluate_sample(loop: Loop, carry: Carry, t: Scalar) -> tuple[Evaluation, Memories, HeldTorque]:
    """Evaluate the law once on the measurement; a memory with a rate advances by Euler's rule."""
    plant, period = loop.plant, loop.period
    measured, sensor, torque, delivery, fresh = carry.state, None, None, None, None
    if plant.sensor is not None:
        measurement, sensor = plant.sensor(carry.k, carry.state, period, carry.sensor)
        measured, fresh = measurement.state, measurement.fresh
    now = evaluate(loop, t, carry.state, measured, carry.memory, t + period)
    memory = now.command.memory_after(period)
    tau = now.command.tau
    if fresh is not None and carry.torque is not None:
        # Without a measurement, the last command and the law's memory stay.
        tau = torque = jnp.where(fresh, tau, carry.torque)
        memory = select(fresh, memory, carry.memory)
    if plant.actuator is not None:
        tau, delivery = plant.actuator.set(tau, period, carry.actuator)
    if plant.sensor is not None or plant.actuator is not None:
        command = eqx.tree_at(lambda c: c.tau, now.command, once(tau))
        if fresh is not None and "rejected" in command.signals:
            # A lost measurement cannot be rejected.
            rejected = jnp.where(fresh, command.signals["rejected"], 0.0)
            command = eqx.tree_at(lambda c: c.signals["rejected"], command, rejected)
        now = checked_evaluation(loop, t, carry.state, carry.memory, now.reference, command)
    memories = Memories(memory=memory, sensor=sensor, actuator=delivery, torque=torque)
    return now, memories, HeldTorque(tau=now.command.tau, delivery=delivery)


def delivered(loop: Loop, held: HeldTorque, t: Scalar, time: Scalar) -> Vector:
    """Torque on the joints, [n], N m or N, at a time [s] at most a period after the sample at t [s]."""
    if loop.plant.actuator is None or held.delivery is None:
        return held.tau
    return loop.plant.actuator.delivered(held.delivery, time - t, loop.period)


def moved(loop: Loop, state: State, t: Scalar, held: HeldTorque) -> State:
    """State of slidax's own plant one period after the sample at t [s]."""
    h = loop.period / loop.substeps

    def rate(time: Scalar, state: State) -> tuple[State, None]:
        tau = delivered(loop, held, t, time)
        return State(q=state.dq, dq=loop.plant.acceleration(time, state, tau)), None

    def substep(state: State, i: Int[Array, ""]) -> tuple[State, None]:
        return loop.integrator(rate, t + i.astype(float) * h, state, h)[0], None

    if loop.substeps == 1:
        return loop.integrator(rate, t, state, h)[0]
    return jax.lax.scan(substep, state, jnp.arange(loop.substeps))[0]


def force(loop: Loop, held: HeldTorque, k: Int[Array, ""], i: Int[Array, ""], state: State) -> Vector:
    """Force on the joints at the start of a substep: delivered torque and disturbance, [n], N m or N.

    For another simulator of the robot, at the exact times of slidax's own plant.

    - `k`: number of the sample.
    - `i`: number of the substep after it, from 0.
    """
    t = k.astype(float) * loop.period
    time = t + i.astype(float) * (loop.period / loop.substeps)
    return delivered(loop, held, t, time) + loop.plant.disturbance(time, state)
