"""One sample of the closed loop as a pure function, for all engines."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax._types import Memory, Scalar, State, Vector
from slidax.controllers import AbstractController, SampledData
from slidax.numerics import select
from slidax.trajectories import ToolMotion

from .evaluation import Evaluation, evaluate
from .excursion import Excursion
from .loop import Carry, Loop, LoopStart, Memories
from .outcome import earlier, no_fault
from .period import HeldTorque, evaluate_sample, moved
from .promise import Promise
from .run import Log
from .tally import Tally
from .tool import Tool
from .tube import Watched


class PlantState(eqx.Module):
    """State of the integrator: the arm's, and the controller's memory if that has a rate, else None."""

    q: Vector
    dq: Vector
    memory: Memory


def begin(loop: Loop, state: State) -> LoopStart:
    """Return the carry before the first sample, with the envelope, the reference and the holding torque at t = 0."""
    t = jnp.zeros(())
    reference = loop.trajectory.reference(t)
    plant, period = loop.plant, loop.period
    sensor, torque = None, None
    # Until the run begins, the arm is held at rest or in uniform motion, with its payload at t = 0.
    held = plant.at(t).bias(state.q, state.dq)
    measured = state
    if plant.sensor is not None:
        sensor = plant.sensor.init(state)
        measured = plant.sensor(jnp.zeros((), int), state, period, sensor)[0].state
        torque = held
    memory = loop.controller.init(t, measured, reference)
    joints = state.q.shape[0]
    tolerance = None if loop.tolerance is None else Watched.begin(loop.tolerance, state.q - reference.q)
    carry = Carry(
        k=jnp.zeros((), int),
        state=state,
        good=state,
        memory=memory,
        tally=Tally.empty(
            joints,
            loop.windows.bands.shape[0],
            tolerance,
            Promise.begin() if _has_monitor(loop.controller) else None,
            Tool.begin(loop.plant.robot) if isinstance(loop.trajectory, ToolMotion) else None,
            gated=isinstance(loop.controller, SampledData),
        ),
        fault=no_fault(),
        excursion=Excursion.none(joints) if loop.recover else None,
        sensor=sensor,
        actuator=None if plant.actuator is None else plant.actuator.init(held),
        torque=torque,
    )
    return carry, loop.controller.envelope(t, memory), reference, None if plant.actuator is None else held


def sample(loop: Loop, carry: Carry) -> tuple[Carry, Log]:
    """Evaluate the law, count the sample, and move the plant by one period, unless the run is over."""
    t = carry.k.astype(float) * loop.period
    if loop.continuous:
        return _counted(loop, carry, t, *_continuous_step(loop, carry, t))
    now, memories, held = evaluate_sample(loop, carry, t)
    return _counted(loop, carry, t, moved(loop, carry.state, t, held), memories, (now,))


def decide(loop: Loop, carry: Carry) -> tuple[Carry, Log, HeldTorque]:
    """Evaluate the law in held mode and count the sample; another simulator moves the carry's state."""
    t = carry.k.astype(float) * loop.period
    now, memories, held = evaluate_sample(loop, carry, t)
    after, log = _counted(loop, carry, t, carry.state, memories, (now,))
    return after, log, held


def _counted(
    loop: Loop, carry: Carry, t: Scalar, moved: State, memories: Memories, stages: tuple[Evaluation, ...]
) -> tuple[Carry, Log]:
    """The carry after a sample, and its log."""
    now = stages[0]
    e = carry.state.q - now.reference.q

    running = carry.fault.absent & (carry.k <= loop.last)
    good = running & now.fault.absent
    moves = carry.k < loop.last
    fault = now.fault
    for stage in stages[1:]:
        fault = earlier(fault, jax.tree.map(lambda x: jnp.where(moves, x, jnp.zeros_like(x)), stage.fault))
    onward = good & fault.absent & moves

    counted = carry.tally.add(carry.k, e, now.command.tau, now.envelope, loop.windows)
    tally = select(good, counted, carry.tally.with_violation(running & (now.fault.kind == 1)))
    excursion = carry.excursion
    if excursion is not None and now.envelope is not None:
        # Also where the law is undefined, which is the case outside.
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
        # k also grows in ended runs, so that a batch has one time and shares all that depends on time alone.
        k=carry.k + 1,
        state=select(onward, moved, carry.state),
        good=select(good, carry.state, carry.good),
        memory=select(onward, memories.memory, carry.memory),
        tally=tally,
        fault=select(running, fault, carry.fault),
        excursion=excursion,
        sensor=memories.sensor,
        actuator=memories.actuator,
        torque=memories.torque,
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


def _continuous_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, Memories, tuple[Evaluation, ...]]:
    """The law at every stage of the integrator, as in a fixed-step solver of block diagrams."""

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
