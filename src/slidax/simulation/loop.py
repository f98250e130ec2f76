"""One sample of the closed loop as pure functions, for all engines.

In held mode the law is evaluated once per sample, and its torque is held for the period. In continuous mode the law is
evaluated at every stage of the integrator. A fault is an error outside the envelope, or a value that is not finite.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from slidax.core.tracing import barrier, select
from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.law.controllers import AbstractController
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.sampled.controller import SampledData
from slidax.motions.trajectory import AbstractMotion, ToolMotion
from slidax.plant.transmissions import TransmissionState

from .outcome import Excursion, Fault, find_fault, first_fault, no_fault
from .plant import Plant
from .run import Log
from .tally import MonitorTally, Tally, ToleranceTally, ToolTally, Windows

Integrator = Callable[..., tuple[Any, tuple[Any, ...]]]
"""Function that takes one integration step, such as `slidax.core.runge_kutta_4`."""


class ClosedLoop(eqx.Module):
    """The constant parts of a closed loop, as opposed to its `Carry`.

    - `period`: time between samples [s].
    - `last`: number of the last sample, N.
    - `windows`: time windows of the statistics, and settling bands.
    - `integrator`: function that takes one integration step of the plant.
    - `substeps`: number of integration steps per period, in held mode.
    - `continuous`: True for continuous mode, False for held mode.
    - `recover`: True to continue a run outside the envelope.
    - `tolerance`: tolerance band of the error, by which the run is judged; None without one.
    """

    plant: Plant
    controller: AbstractController
    trajectory: AbstractMotion
    period: Scalar
    last: Int[Array, ""]
    windows: Windows
    integrator: Integrator = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    continuous: bool = eqx.field(static=True)
    recover: bool = eqx.field(static=True)
    tolerance: PrescribedPerformance | None = None


class Carry(eqx.Module):
    """The changing parts of a closed loop, which each sample reads and replaces.

    - `k`: number of the next sample.
    - `state`: the true state at this sample.
    - `good`: the true state at the last sample without a fault.
    - `memory`, `sensor`, `actuator`: memories of the controller, the sensor and the actuator.
    - `tally`: statistics of all samples before sample k.
    - `fault`: the first fault.
    - `excursion`: samples outside the envelope; None if the first of them ends the run.
    - `torque`: the last command [n], which is applied again while measurements are lost; None without a sensor.
    - `transmission`: state of LuGre friction and elastic joints; None without a transmission.
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
    transmission: TransmissionState | None = None


class Memories(eqx.Module):
    """The memories of controller, sensor and actuator after a sample, and the last command, as in `Carry`."""

    memory: Memory
    sensor: Memory
    actuator: Memory
    torque: Vector | None


LoopStart = tuple[Carry, Envelope | None, Reference, Float[Array, "*runs n"] | Float[np.ndarray, "*runs n"] | None]
"""Carry, envelope and reference at t = 0, and the torque that holds the arm there [n], N m or N (None without an
actuator)."""


class Evaluation(eqx.Module):
    """Result of the law at one time: reference, command, envelope, and a fault if there is one."""

    reference: Reference
    command: Command
    envelope: Envelope | None
    fault: Fault


def evaluate(loop: ClosedLoop, t: Scalar, state: State, measured: State, memory: Memory, ahead: Scalar) -> Evaluation:
    """Evaluate the law on the measured state at time t [s], and check the true state for a fault.

    - `state`, `measured`: the true state, and the state that the controller sees.
    - `memory`: the controller's memory.
    - `ahead`: time of the next sample [s].
    """
    reference = loop.trajectory.reference(t)
    command = loop.controller(t, measured, reference, loop.trajectory.reference(ahead), memory)
    # The barrier makes plant, tally and log use bitwise equal torques.
    command = eqx.tree_at(lambda c: c.tau, command, barrier(command.tau))
    return checked_evaluation(loop, t, state, memory, reference, command)


def checked_evaluation(
    loop: ClosedLoop, t: Scalar, state: State, memory: Memory, reference: Reference, command: Command
) -> Evaluation:
    """Return the `Evaluation` for a command of the law, with the envelope, and a fault if the true state has one.

    - `state`: the true state.
    - `memory`: the controller's memory before the command.
    """
    envelope = loop.controller.envelope(t, memory)
    finite = jnp.isfinite(command.tau) & jnp.isfinite(state.dq)
    fault = find_fault(t, state.q - reference.q, finite, None if loop.recover else envelope)
    return Evaluation(reference, command, envelope, fault)


class HeldTorque(eqx.Module):
    """Torque command that is held until the next sample.

    - `tau`: command [n], N m or N.
    - `actuator`: the actuator's memory; None without one.
    """

    tau: Vector
    actuator: Memory


def evaluate_sample(loop: ClosedLoop, carry: Carry, t: Scalar) -> tuple[Evaluation, Memories, HeldTorque]:
    """Evaluate the law once on the measurement; return the evaluation, the new memories and the torque of the period.

    If the law returns a rate of its memory, the memory advances by Euler's rule.
    """
    plant, period = loop.plant, loop.period
    sensed = _sensed(plant, carry.state, carry.transmission)
    measured, sensor, torque, actuator, fresh = sensed, None, None, None, None
    if plant.sensor is not None:
        measurement, sensor = plant.sensor(carry.k, sensed, period, carry.sensor)
        measured, fresh = measurement.state, measurement.fresh
    now = evaluate(loop, t, carry.state, measured, carry.memory, t + period)
    memory = now.command.memory_after(period)
    tau = now.command.tau
    if fresh is not None and carry.torque is not None:
        # Without a new measurement, the last command and the law's memory are kept.
        tau = torque = jnp.where(fresh, tau, carry.torque)
        memory = select(fresh, memory, carry.memory)
    if plant.actuator is not None:
        tau, actuator = plant.actuator.set(tau, period, carry.actuator)
    if plant.sensor is not None or plant.actuator is not None:
        command = eqx.tree_at(lambda c: c.tau, now.command, barrier(tau))
        if fresh is not None and "rejected" in command.signals:
            # A lost measurement cannot be rejected.
            rejected = jnp.where(fresh, command.signals["rejected"], 0.0)
            command = eqx.tree_at(lambda c: c.signals["rejected"], command, rejected)
        now = checked_evaluation(loop, t, carry.state, carry.memory, now.reference, command)
    memories = Memories(memory=memory, sensor=sensor, actuator=actuator, torque=torque)
    return now, memories, HeldTorque(tau=now.command.tau, actuator=actuator)


def _sensed(plant: Plant, state: State, own: TransmissionState | None) -> State:
    """Return the state that the sensors measure: of the links, or of the motors if the joints are elastic.

    - `own`: state of the transmission; None without one.
    """
    return state if plant.transmission is None or own is None else plant.transmission.measured(state, own)


def delivered_torque(loop: ClosedLoop, held: HeldTorque, t: Scalar, time: Scalar) -> Vector:
    """Return the torque on the joints, [n], N m or N, at a time within the period that begins with the sample at t.

    - `t`, `time`: time of the sample, and time of the torque [s].
    """
    if loop.plant.actuator is None or held.actuator is None:
        return held.tau
    return loop.plant.actuator.delivered(held.actuator, time - t, loop.period)


def move_plant(loop: ClosedLoop, state: State, t: Scalar, held: HeldTorque) -> State:
    """Return the state of slidax's own plant one period after the sample at t [s]."""
    h = loop.period / loop.substeps

    def rate(time: Scalar, state: State) -> tuple[State, None]:
        tau = delivered_torque(loop, held, t, time)
        return State(q=state.dq, dq=loop.plant.acceleration(time, state, tau)), None

    def substep(state: State, i: Int[Array, ""]) -> tuple[State, None]:
        return loop.integrator(rate, t + i.astype(float) * h, state, h)[0], None

    if loop.substeps == 1:
        return loop.integrator(rate, t, state, h)[0]
    return jax.lax.scan(substep, state, jnp.arange(loop.substeps))[0]


def move_both(
    loop: ClosedLoop, state: State, own: TransmissionState | None, t: Scalar, held: HeldTorque
) -> tuple[State, TransmissionState | None]:
    """Return the states of arm and transmission one period after the sample at t [s].

    - `own`: state of the transmission; None without one.
    """
    if own is None:
        return move_plant(loop, state, t, held), None
    h = loop.period / loop.substeps

    def substep(both: tuple[State, TransmissionState], i: Int[Array, ""]) -> tuple[Any, None]:
        time = t + i.astype(float) * h
        return loop.plant.step(time, *both, delivered_torque(loop, held, t, time), h), None

    return jax.lax.scan(substep, (state, own), jnp.arange(loop.substeps))[0]


def force(loop: ClosedLoop, held: HeldTorque, k: Int[Array, ""], i: Int[Array, ""], state: State) -> Vector:
    """Return the force on the joints at the start of a substep: delivered torque plus disturbance, [n], N m or N.

    MuJoCo moves the arm under this force. The substeps' times are bitwise those of `move_plant`.

    - `held`: torque command of the sample.
    - `k`: number of the sample.
    - `i`: number of the substep after it, from 0.
    - `state`: the true state at the start of the substep, on which the disturbance may depend.
    """
    t = k.astype(float) * loop.period
    time = t + i.astype(float) * (loop.period / loop.substeps)
    return delivered_torque(loop, held, t, time) + loop.plant.disturbance(time, state)


class PlantState(eqx.Module):
    """State of the integrator in continuous mode: the arm's state, and the controller's memory.

    `memory` is None if the law returns no rate for its memory; then the memory is not integrated.
    """

    q: Vector
    dq: Vector
    memory: Memory


def begin(loop: ClosedLoop, state: State) -> LoopStart:
    """Return the carry before the first sample, with the envelope, the reference and the holding torque at t = 0.

    - `state`: the true state at t = 0.
    """
    t = jnp.zeros(())
    reference = loop.trajectory.reference(t)
    plant, period = loop.plant, loop.period
    sensor, torque = None, None
    # Before the run, the torque `held` keeps the arm at rest or in uniform motion, with its payload at t = 0.
    held = plant.at(t).bias(state.q, state.dq)
    transmission = None if plant.transmission is None else plant.transmission.begin(state, held)
    measured = sensed = _sensed(plant, state, transmission)
    if plant.sensor is not None:
        sensor = plant.sensor.init(sensed)
        measured = plant.sensor(jnp.zeros((), int), sensed, period, sensor)[0].state
        torque = held if plant.actuator is None else plant.actuator.command(held)
    memory = loop.controller.init(t, measured, reference)
    joints = state.q.shape[0]
    tolerance = None if loop.tolerance is None else ToleranceTally.begin(loop.tolerance, state.q - reference.q)
    carry = Carry(
        k=jnp.zeros((), int),
        state=state,
        good=state,
        memory=memory,
        tally=Tally.empty(
            joints,
            loop.windows.bands.shape[0],
            tolerance,
            MonitorTally.begin() if _has_monitor(loop.controller) else None,
            ToolTally.begin(loop.plant.robot) if isinstance(loop.trajectory, ToolMotion) else None,
            gated=isinstance(loop.controller, SampledData),
        ),
        fault=no_fault(),
        excursion=Excursion.none(joints) if loop.recover else None,
        sensor=sensor,
        actuator=None if plant.actuator is None else plant.actuator.init(held),
        torque=torque,
        transmission=transmission,
    )
    return carry, loop.controller.envelope(t, memory), reference, None if plant.actuator is None else held


def sample(loop: ClosedLoop, carry: Carry) -> tuple[Carry, Log]:
    """Evaluate the law, add the sample to the statistics, and move the plant by one period, unless the run is over.

    Returns the carry of the next sample, and the log of this one.
    """
    t = carry.k.astype(float) * loop.period
    if loop.continuous:
        moved, memories, stages = _continuous_step(loop, carry, t)
        return _advance_carry(loop, carry, t, (moved, None), memories, stages)
    now, memories, held = evaluate_sample(loop, carry, t)
    moved_both = move_both(loop, carry.state, carry.transmission, t, held)
    return _advance_carry(loop, carry, t, moved_both, memories, (now,))


def decide(loop: ClosedLoop, carry: Carry) -> tuple[Carry, Log, HeldTorque]:
    """Evaluate the law in held mode and add the sample to the statistics; MuJoCo then moves the carry's state.

    Returns the carry with an unchanged state, the sample's log, and the torque of the period.
    """
    t = carry.k.astype(float) * loop.period
    now, memories, held = evaluate_sample(loop, carry, t)
    after, log = _advance_carry(loop, carry, t, (carry.state, None), memories, (now,))
    return after, log, held


def _advance_carry(
    loop: ClosedLoop,
    carry: Carry,
    t: Scalar,
    moved: tuple[State, TransmissionState | None],
    memories: Memories,
    stages: tuple[Evaluation, ...],
) -> tuple[Carry, Log]:
    """Return the carry after a sample, and the sample's log.

    - `moved`: states of arm and transmission after the period.
    - `memories`: memories after the sample.
    - `stages`: evaluations at the integrator's stages, the one at t first; in held mode only that one.
    """
    now = stages[0]
    e = carry.state.q - now.reference.q

    running = carry.fault.absent & (carry.k <= loop.last)
    good = running & now.fault.absent
    moves = carry.k < loop.last
    fault = now.fault
    for stage in stages[1:]:
        fault = first_fault(fault, jax.tree.map(lambda x: jnp.where(moves, x, jnp.zeros_like(x)), stage.fault))
    onward = good & fault.absent & moves

    counted = carry.tally.add(carry.k, e, now.command.tau, now.envelope, loop.windows)
    tally = select(good, counted, carry.tally.with_violation(running & (now.fault.kind == 1)))
    excursion = carry.excursion
    if excursion is not None and now.envelope is not None:
        # This also counts samples outside, where the law is undefined.
        known = running & jnp.all(jnp.isfinite(e))
        extended = excursion.add(carry.k, e, now.envelope)
        tally = tally.with_violation(known & extended.outside)
        excursion = select(known, extended, excursion)
    if loop.tolerance is not None:
        tally = tally.with_tolerance(loop.tolerance, t, e, running)
    tally = tally.with_margin(carry.k, now.command.signals, good)
    tally = tally.with_rejection(now.command.signals, good)
    if tally.tool is not None:
        steady = good & (carry.k >= loop.windows.steady)
        tool = tally.tool.add(loop.plant.robot, carry.state.q, now.reference.q, good, steady)
        tally = eqx.tree_at(lambda tally: tally.tool, tally, tool)
    after = Carry(
        # k also increases in ended runs: then all runs of a batch have the same time and share values of time alone.
        k=carry.k + 1,
        state=select(onward, moved[0], carry.state),
        good=select(good, carry.state, carry.good),
        memory=select(onward, memories.memory, carry.memory),
        tally=tally,
        fault=select(running, fault, carry.fault),
        excursion=excursion,
        sensor=memories.sensor,
        actuator=memories.actuator,
        torque=memories.torque,
        transmission=None if carry.transmission is None else select(onward, moved[1], carry.transmission),
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


def _has_monitor(controller: AbstractController) -> bool:
    return getattr(controller, "monitor", None) is not None


def _continuous_step(loop: ClosedLoop, carry: Carry, t: Scalar) -> tuple[State, Memories, tuple[Evaluation, ...]]:
    """Take a step with the law evaluated at every stage of the integrator, as fixed-step solvers of block diagrams do.

    Returns the state and the memories after the step, and the evaluations at all stages.
    """

    def at(t: Scalar, state: State, memory: Memory) -> Evaluation:
        return evaluate(loop, t, state, state, memory, ahead)

    ahead = t + loop.period
    has_rate = eqx.filter_eval_shape(at, t, carry.state, carry.memory).command.rate is not None

    def rate(t: Scalar, now: PlantState) -> tuple[PlantState, Evaluation]:
        state = State(q=now.q, dq=now.dq)
        stage = at(t, state, now.memory if has_rate else carry.memory)
        acceleration = loop.plant.acceleration(t, state, stage.command.tau)
        return PlantState(q=now.dq, dq=acceleration, memory=stage.command.rate), stage

    start = PlantState(q=carry.state.q, dq=carry.state.dq, memory=carry.memory if has_rate else None)
    moved, stages = loop.integrator(rate, t, start, loop.period)
    memory = moved.memory if has_rate else stages[0].command.memory
    memories = Memories(memory=memory, sensor=None, actuator=None, torque=None)
    return State(q=moved.q, dq=moved.dq), memories, stages
