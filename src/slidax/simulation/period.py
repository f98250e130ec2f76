"""One period in held mode: the law decides once, and its torque is held until the next sample."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax._types import Memory, Scalar, State, Vector
from slidax.numerics import once, select

from .evaluation import Evaluation, evaluate, judged
from .loop import Carry, Loop, Passed


class HeldTorque(eqx.Module):
    """What a sample leaves to act on the joints until the next one.

    - `tau`: torque that is set [n], N m or N.
    - `delivery`: the actuator's memory; None without one.
    """

    tau: Vector
    delivery: Memory


def decided(loop: Loop, carry: Carry, t: Scalar) -> tuple[Evaluation, Passed, HeldTorque]:
    """The law once, on what is measured; a memory with a rate moves on by Euler's rule.

    - `loop`: what stays the same.
    - `carry`: what changes.
    - `t`: time of the sample [s].
    """
    plant, period = loop.plant, loop.period
    seen, sensor, torque, delivery, fresh = carry.state, None, None, None, None
    if plant.sensor is not None:
        measurement, sensor = plant.sensor(carry.k, carry.state, period, carry.sensor)
        seen, fresh = measurement.state, measurement.fresh
    now = evaluate(loop, t, carry.state, seen, carry.memory, t + period)
    memory = now.command.memory_after(period)
    tau = now.command.tau
    if fresh is not None and carry.torque is not None:
        # No measurement, no new command: the last one stands, and the law has seen nothing.
        tau = torque = jnp.where(fresh, tau, carry.torque)
        memory = select(fresh, memory, carry.memory)
    if plant.actuator is not None:
        tau, delivery = plant.actuator.set(tau, period, carry.actuator)
    if plant.sensor is not None or plant.actuator is not None:
        command = eqx.tree_at(lambda c: c.tau, now.command, once(tau))
        if fresh is not None and "rejected" in command.signals:
            # A measurement that was lost on the way cannot be rejected.
            rejected = jnp.where(fresh, command.signals["rejected"], 0.0)
            command = eqx.tree_at(lambda c: c.signals["rejected"], command, rejected)
        now = judged(loop, t, carry.state, carry.memory, now.reference, command)
    passed = Passed(memory=memory, sensor=sensor, actuator=delivery, torque=torque)
    return now, passed, HeldTorque(tau=now.command.tau, delivery=delivery)


def delivered(loop: Loop, held: HeldTorque, t: Scalar, time: Scalar) -> Vector:
    """The torque on the joints, [n], N m or N.

    - `loop`: what stays the same.
    - `held`: what the last sample left.
    - `t`: time of that sample [s].
    - `time`: now [s], at most a period later.
    """
    if loop.plant.actuator is None or held.delivery is None:
        return held.tau
    return loop.plant.actuator.delivered(held.delivery, time - t, loop.period)


def moved(loop: Loop, state: State, t: Scalar, held: HeldTorque) -> State:
    """The plant's own state one period later.

    - `loop`: what stays the same.
    - `state`: at the sample.
    - `t`: time of the sample [s].
    - `held`: what the sample left.
    """
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
    """What pushes the joints at the start of a substep: the torque delivered and the disturbance, [n], N m or N.

    For another simulator of the robot, at the very times at which our own plant would ask.

    - `loop`: what stays the same.
    - `held`: what sample k left.
    - `k`: number of the sample.
    - `i`: number of the substep after it, from 0 on.
    - `state`: at that time.
    """
    t = k.astype(float) * loop.period
    time = t + i.astype(float) * (loop.period / loop.substeps)
    return delivered(loop, held, t, time) + loop.plant.disturbance(time, state)
