"""The closed loop as one pure, scanned function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.controllers import AbstractController
from slidax.trajectories import AbstractTrajectory

from .outcome import Fault, earlier, find_fault, no_fault
from .plant import Plant
from .run import Log
from .tally import Tally, Windows

Integrator = Callable[..., tuple[State, tuple[Any, ...]]]


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
    """All that changes while time passes: the next sample's number, the state there and at the last good sample, the
    memory, and what was found."""

    k: Int[Array, ""]
    state: State
    good: State
    memory: Memory
    tally: Tally
    fault: Fault


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


def advance(loop: Loop, carry: Carry, points: int, every: int | None) -> tuple[Carry, Log | None]:
    """The carry after `points * (every or 1)` samples, with every `every`-th of them logged.

    - `loop`: what stays the same.
    - `carry`: what changes.
    - `points`: how many samples to log.
    - `every`: one in how many samples is logged; None logs none.
    """

    def sample(carry: Carry, _: None) -> tuple[Carry, Log]:
        return _sample(loop, carry)

    def unlogged(carry: Carry, _: None) -> tuple[Carry, None]:
        return _sample(loop, carry)[0], None

    def group(carry: Carry, _: None) -> tuple[Carry, Log]:
        carry, logs = jax.lax.scan(sample, carry, None, length=every)
        return carry, jax.tree.map(lambda x: x[0], logs)

    if every is None:
        return jax.lax.scan(unlogged, carry, None, length=points)
    return jax.lax.scan(sample if every == 1 else group, carry, None, length=points)


def _sample(loop: Loop, carry: Carry) -> tuple[Carry, Log]:
    """One sample: evaluate the law, count it, move the plant one period on, unless the run is over."""
    t = carry.k.astype(float) * loop.period
    moved, stages = (_continuous_step if loop.continuous else _held_step)(loop, carry, t)
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
        k=carry.k + running.astype(int),
        state=_where(onward, moved, carry.state),
        good=_where(good, carry.state, carry.good),
        memory=_where(onward, now.command.memory, carry.memory),
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
    envelope = loop.controller.envelope(t, memory)
    finite = jnp.isfinite(command.tau) & jnp.isfinite(state.dq)
    return Evaluation(reference, command, envelope, find_fault(t, state.q - reference.q, finite, envelope))


def _held_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, tuple[Evaluation, ...]]:
    """The law once, its torque held over the period."""
    now = _evaluate(loop, t, carry.state, carry.memory, t + loop.period)
    h = loop.period / loop.substeps

    def rate(t: Scalar, state: State) -> tuple[State, None]:
        return State(q=state.dq, dq=loop.plant.acceleration(t, state, now.command.tau)), None

    def substep(state: State, i: Int[Array, ""]) -> tuple[State, None]:
        return loop.integrator(rate, t + i.astype(float) * h, state, h)[0], None

    if loop.substeps == 1:
        return loop.integrator(rate, t, carry.state, h)[0], (now,)
    return jax.lax.scan(substep, carry.state, jnp.arange(loop.substeps))[0], (now,)


def _continuous_step(loop: Loop, carry: Carry, t: Scalar) -> tuple[State, tuple[Evaluation, ...]]:
    """The law in every stage of the integrator, as a fixed-step solver of block diagrams does."""

    def rate(t: Scalar, state: State) -> tuple[State, Evaluation]:
        stage = _evaluate(loop, t, state, carry.memory, t + loop.period)
        return State(q=state.dq, dq=loop.plant.acceleration(t, state, stage.command.tau)), stage

    return loop.integrator(rate, t, carry.state, loop.period)


def _where(condition: Array, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)
