"""The closed loop as one pure, scanned function."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Int

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.controllers import AbstractController
from slidax.numerics import once
from slidax.trajectories import AbstractTrajectory

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


class Carry(eqx.Module):
    """All that changes while time passes.

    - `k`: number of the next sample.
    - `state`: the state there.
    - `good`: the state at the last good sample.
    - `memory`: the controller's.
    - `tally`: what was counted.
    - `fault`: the first thing that went wrong.
    """

    k: Int[Array, ""]
    state: State
    good: State
    memory: Memory
    tally: Tally
    fault: Fault


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


def begin(loop: Loop, state: State) -> tuple[Carry, Envelope | None, Reference]:
    """The carry before the first sample, with the envelope and the reference there.

    - `loop`: what stays the same.
    - `state`: the state at t = 0.
    """
    t = jnp.zeros(())
    reference = loop.trajectory.reference(t)
    memory = loop.controller.init(t, state, reference)
    carry = Carry(
        k=jnp.zeros((), int),
        state=state,
        good=state,
        memory=memory,
        tally=Tally.empty(state.q.shape[0], loop.windows.bands.shape[0]),
        fault=no_fault(),
    )
    return carry, loop.controller.envelope(t, memory), reference


def advance(loop: Loop, carry: Carry, points: int, every: int | None, *, pack: bool) -> tuple[Carry, Log | None]:
    """The carry after `points * (every or 1)` samples, with every `every`-th of them logged.

    - `loop`: what stays the same.
    - `carry`: what changes.
    - `points`: how many samples to log.
    - `every`: one in how many samples is logged; None logs none.
    - `pack`: pass what stays the same as one array. Faster for a single run; a batch then shares nothing.
    """
    arrays, rest = eqx.partition(loop, eqx.is_inexact_array)
    packed, unpack = ravel_pytree(arrays)

    def sample(carry: Carry, _: None) -> tuple[Carry, Log]:
        # One array instead of dozens: XLA looks up the address of each in every step.
        same = eqx.combine(unpack(once(packed)), rest) if pack else loop
        # Tied together, so that a run rounds alike whether it is logged or not.
        tied: tuple[Carry, Log] = jax.lax.optimization_barrier(_sample(same, carry))
        return tied

    def unlogged(carry: Carry, _: None) -> tuple[Carry, None]:
        return sample(carry, None)[0], None

    def group(carry: Carry, _: None) -> tuple[Carry, Log]:
        carry, logs = jax.lax.scan(sample, carry, None, length=every)
        return carry, jax.tree.map(lambda x: x[0], logs)

    if every is None:
        return jax.lax.scan(unlogged, carry, None, length=points)
    return jax.lax.scan(sample if every == 1 else group, carry, None, length=points)


def _sample(loop: Loop, carry: Carry) -> tuple[Carry, Log]:
    """One sample: evaluate the law, count it, move the plant one period on, unless the run is over."""
    t = carry.k.astype(float) * loop.period
    moved, memory, stages = (_continuous_step if loop.continuous else _held_step)(loop, carry, t)
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
    after = Carry(
        # The number grows in runs that are over, too: so a batch has one time, and shares what depends on time alone.
        k=carry.k + 1,
        state=_where(onward, moved, carry.state),
        good=_where(good, carry.state, carry.good),
        memory=_where(onward, memory, carry.memory),
        tally=tally,
        fault=_where(running, found, carry.fault),
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


def _evaluate(loop: Loop, t: Scalar, state: State, memory: Memory, ahead: Scalar) -> Evaluation:
    reference = loop.trajectory.reference(t)
    command = loop.controller(t, state, reference, loop.trajectory.reference(ahead), memory)
    # Plant, tally and log read the same bits.
    command = eqx.tree_at(lambda c: c.tau, command, once(command.tau))
    envelope = loop.controller.envelope(t, memory)
    finite = jnp.isfinite(command.tau) & jnp.isfinite(state.dq)
    return Evaluation(reference, command, envelope, find_fault(t, state.q - reference.q, finite, envelope))


def _held_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, Memory, tuple[Evaluation, ...]]:
    """The law once, its torque held over the period; a memory with a rate moves on by Euler's rule."""
    now = _evaluate(loop, t, carry.state, carry.memory, t + loop.period)
    h = loop.period / loop.substeps

    def rate(t: Scalar, state: State) -> tuple[State, None]:
        return State(q=state.dq, dq=loop.plant.acceleration(t, state, now.command.tau)), None

    def substep(state: State, i: Int[Array, ""]) -> tuple[State, None]:
        return loop.integrator(rate, t + i.astype(float) * h, state, h)[0], None

    memory = now.command.memory
    if now.command.rate is not None:
        memory = jax.tree.map(lambda m, dm: m + loop.period * dm, memory, now.command.rate)
    if loop.substeps == 1:
        return loop.integrator(rate, t, carry.state, h)[0], memory, (now,)
    return jax.lax.scan(substep, carry.state, jnp.arange(loop.substeps))[0], memory, (now,)


def _continuous_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, Memory, tuple[Evaluation, ...]]:
    """The law in every stage of the integrator, as a fixed-step solver of block diagrams does."""
    evaluate = partial(_evaluate, ahead=t + loop.period)
    has_rate = eqx.filter_eval_shape(evaluate, loop, t, carry.state, carry.memory).command.rate is not None

    def rate(t: Scalar, now: Moving) -> tuple[Moving, Evaluation]:
        state = State(q=now.q, dq=now.dq)
        stage = evaluate(loop, t, state, now.memory if has_rate else carry.memory)
        acceleration = loop.plant.acceleration(t, state, stage.command.tau)
        return Moving(q=now.dq, dq=acceleration, memory=stage.command.rate), stage

    start = Moving(q=carry.state.q, dq=carry.state.dq, memory=carry.memory if has_rate else None)
    moved, stages = loop.integrator(rate, t, start, loop.period)
    memory = moved.memory if has_rate else stages[0].command.memory
    return State(q=moved.q, dq=moved.dq), memory, stages


def _where(condition: Array, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)
