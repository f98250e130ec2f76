"""One sample of the closed loop as a pure function, whichever engine runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.controllers import AbstractController
from slidax.numerics import once
from slidax.trajectories import AbstractTrajectory

from .excursion import Excursion
from .outcome import Fault, earlier, find_fault, no_fault
from .plant import Plant
from .run import Log
from .tally import Tally, Windows

Integrator = Callable[..., tuple[Any, tuple[Any, ...]]]


class Loop(eqx.Module):
    """All that stays the same while time passes.

    - `plant`, `controller`, `trajectory`: who takes part.
    - `period`: time between samples [s].
    - `last`: number of the last sample, N.
    - `windows`: from when each statistic counts.
    - `integrator`: one step of the plant.
    - `substeps`: steps of the plant per period, in held mode.
    - `continuous`: whether the law is evaluated at every stage of the integrator.
    - `recover`: whether the run goes on outside the envelope.
    """

    plant: Plant
    controller: AbstractController
    trajectory: AbstractTrajectory
    period: Scalar
    last: Int[Array, ""]
    windows: Windows
    integrator: Integrator = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    continuous: bool = eqx.field(static=True)
    recover: bool = eqx.field(static=True)


class Carry(eqx.Module):
    """All that changes while time passes.

    - `k`: number of the next sample.
    - `state`: the state there.
    - `good`: the state at the last good sample.
    - `memory`: the controller's.
    - `tally`: what was counted.
    - `fault`: the first thing that went wrong.
    - `excursion`: where it was outside its envelope; None if that ends the run.
    - `sensor`, `actuator`: what those keep.
    - `torque`: the last command [n], which is held while samples are lost; None without a sensor.
    """

    k: Int[Array, ""]
    state: State
    good: State
    memory: Memory
    tally: Tally
    fault: Fault
    excursion: Excursion | None
    sensor: Memory
    actuator: Memory
    torque: Vector | None


Begun = tuple[Carry, Envelope | None, Reference]
"""The carry before the first sample, with the envelope and the reference there."""

Inside = Callable[[State, Reference, Envelope | None], None]
"""Raises a DefinitionError if the first state may not be where it is."""


class Passed(eqx.Module):
    """What one period leaves behind, beside the state: the memories of all who have one."""

    memory: Memory
    sensor: Memory
    actuator: Memory
    torque: Vector | None


class Moving(eqx.Module):
    """What the integrator moves: the arm, and the controller's memory if that has a rate, else None."""

    q: Vector
    dq: Vector
    memory: Memory


class Evaluation(eqx.Module):
    """The law at one time: what it saw, what it answered, and what is wrong."""

    reference: Reference
    command: Command
    envelope: Envelope | None
    fault: Fault


def begin(loop: Loop, state: State) -> Begun:
    """The carry before the first sample, with the envelope and the reference there.

    - `loop`: what stays the same.
    - `state`: the state at t = 0.
    """
    t = jnp.zeros(())
    reference = loop.trajectory.reference(t)
    plant, period = loop.plant, loop.period
    sensor, torque = None, None
    # The arm is held still, or in even motion, until the run begins.
    held = plant.robot.bias(state.q, state.dq)
    measured = state
    if plant.sensor is not None:
        sensor = plant.sensor.init(state)
        measured = plant.sensor(jnp.zeros((), int), state, period, sensor)[0].state
        torque = held
    memory = loop.controller.init(t, measured, reference)
    joints = state.q.shape[0]
    carry = Carry(
        k=jnp.zeros((), int),
        state=state,
        good=state,
        memory=memory,
        tally=Tally.empty(joints, loop.windows.bands.shape[0]),
        fault=no_fault(),
        excursion=Excursion.none(joints) if loop.recover else None,
        sensor=sensor,
        actuator=None if plant.actuator is None else plant.actuator.init(held),
        torque=torque,
    )
    return carry, loop.controller.envelope(t, memory), reference


def sample(loop: Loop, carry: Carry) -> tuple[Carry, Log]:
    """One sample: evaluate the law, count it, move the plant one period on, unless the run is over.

    - `loop`: what stays the same.
    - `carry`: what changes.
    """
    t = carry.k.astype(float) * loop.period
    moved, passed, stages = (_continuous_step if loop.continuous else _held_step)(loop, carry, t)
    now = stages[0]
    e = carry.state.q - now.reference.q

    running = carry.fault.absent & (carry.k <= loop.last)
    good = running & now.fault.absent
    moves = carry.k < loop.last
    found = now.fault
    for stage in stages[1:]:
        found = earlier(found, jax.tree.map(lambda x: jnp.where(moves, x, jnp.zeros_like(x)), stage.fault))
    onward = good & found.absent & moves

    counted = carry.tally.add(carry.k, e, now.command.tau, now.envelope, loop.windows)
    tally = _where(good, counted, carry.tally.with_violation(running & (now.fault.kind == 1)))
    excursion = carry.excursion
    if excursion is not None and now.envelope is not None:
        # Also where the law has no answer: being outside is why.
        known = running & jnp.all(jnp.isfinite(e))
        seen = excursion.add(carry.k, e, now.envelope)
        tally = tally.with_violation(known & seen.outside)
        excursion = _where(known, seen, excursion)
    after = Carry(
        # The number grows in runs that are over, too: so a batch has one time, and shares what depends on time alone.
        k=carry.k + 1,
        state=_where(onward, moved, carry.state),
        good=_where(good, carry.state, carry.good),
        memory=_where(onward, passed.memory, carry.memory),
        tally=tally,
        fault=_where(running, found, carry.fault),
        excursion=excursion,
        sensor=passed.sensor,
        actuator=passed.actuator,
        torque=passed.torque,
    )
    log = Log(
        k=carry.k,
        t=t,
        state=carry.state,
        reference=now.reference,
        tau=now.command.tau,
        signals=now.command.signals,
        envelope=now.envelope,
        valid=good,
    )
    return after, log


def _evaluate(loop: Loop, t: Scalar, state: State, seen: State, memory: Memory, ahead: Scalar) -> Evaluation:
    """The law at one time, judged by the true state: the law itself knows what is seen of it."""
    reference = loop.trajectory.reference(t)
    command = loop.controller(t, seen, reference, loop.trajectory.reference(ahead), memory)
    # Plant, tally and log read the same bits.
    command = eqx.tree_at(lambda c: c.tau, command, once(command.tau))
    return _judged(loop, t, state, memory, reference, command)


def _judged(loop: Loop, t: Scalar, state: State, memory: Memory, reference: Reference, command: Command) -> Evaluation:
    envelope = loop.controller.envelope(t, memory)
    finite = jnp.isfinite(command.tau) & jnp.isfinite(state.dq)
    fault = find_fault(t, state.q - reference.q, finite, None if loop.recover else envelope)
    return Evaluation(reference, command, envelope, fault)


def _held_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, Passed, tuple[Evaluation, ...]]:
    """The law once, its torque held over the period; a memory with a rate moves on by Euler's rule."""
    plant, period = loop.plant, loop.period
    seen, sensor, torque, delivery, fresh = carry.state, None, None, None, None
    if plant.sensor is not None:
        measurement, sensor = plant.sensor(carry.k, carry.state, period, carry.sensor)
        seen, fresh = measurement.state, measurement.fresh
    now = _evaluate(loop, t, carry.state, seen, carry.memory, t + period)
    memory = now.command.memory_after(period)
    tau = now.command.tau
    if fresh is not None and carry.torque is not None:
        # No measurement, no new command: the last one stands, and the law has seen nothing.
        tau = torque = jnp.where(fresh, tau, carry.torque)
        memory = _where(fresh, memory, carry.memory)
    if plant.actuator is not None:
        tau, delivery = plant.actuator.set(tau, period, carry.actuator)
    if plant.sensor is not None or plant.actuator is not None:
        command = eqx.tree_at(lambda c: c.tau, now.command, once(tau))
        now = _judged(loop, t, carry.state, carry.memory, now.reference, command)
    h = period / loop.substeps

    def rate(time: Scalar, state: State) -> tuple[State, None]:
        delivered = now.command.tau
        if plant.actuator is not None and delivery is not None:
            delivered = plant.actuator.delivered(delivery, time - t, period)
        return State(q=state.dq, dq=plant.acceleration(time, state, delivered)), None

    def substep(state: State, i: Int[Array, ""]) -> tuple[State, None]:
        return loop.integrator(rate, t + i.astype(float) * h, state, h)[0], None

    passed = Passed(memory=memory, sensor=sensor, actuator=delivery, torque=torque)
    if loop.substeps == 1:
        return loop.integrator(rate, t, carry.state, h)[0], passed, (now,)
    return jax.lax.scan(substep, carry.state, jnp.arange(loop.substeps))[0], passed, (now,)


def _continuous_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, Passed, tuple[Evaluation, ...]]:
    """The law in every stage of the integrator, as a fixed-step solver of block diagrams does."""

    def evaluate(t: Scalar, state: State, memory: Memory) -> Evaluation:
        return _evaluate(loop, t, state, state, memory, ahead)

    ahead = t + loop.period
    has_rate = eqx.filter_eval_shape(evaluate, t, carry.state, carry.memory).command.rate is not None

    def rate(t: Scalar, now: Moving) -> tuple[Moving, Evaluation]:
        state = State(q=now.q, dq=now.dq)
        stage = evaluate(t, state, now.memory if has_rate else carry.memory)
        acceleration = loop.plant.acceleration(t, state, stage.command.tau)
        return Moving(q=now.dq, dq=acceleration, memory=stage.command.rate), stage

    start = Moving(q=carry.state.q, dq=carry.state.dq, memory=carry.memory if has_rate else None)
    moved, stages = loop.integrator(rate, t, start, loop.period)
    memory = moved.memory if has_rate else stages[0].command.memory
    passed = Passed(memory=memory, sensor=None, actuator=None, torque=None)
    return State(q=moved.q, dq=moved.dq), passed, stages


def _where(condition: Array, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)
