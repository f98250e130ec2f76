"""Random samples inside the envelope with a memory that fits them, and samples with bad numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax._types import Command, Reference, Scalar, State, Vector
from slidax.trajectories import AbstractTrajectory

from .guarded_step import GuardedStep
from .step_memory import Status, StepMemory

INSIDE = 0.95
"""Largest drawn error, as a share of its bound."""

BAD_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 5e-324, -1e-310)
"""Numbers that no sensor should deliver."""

AT_ONCE = 100
"""Samples answered by one call."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

QUICKLY = {"xla_backend_optimization_level": 0}
"""A few hundred samples need no fast code, whose compilation takes four times as long."""


def _compiled_quickly(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    jit: Any = eqx.filter_jit
    return jit(function, compiler_options=QUICKLY)


class Sample(eqx.Module):
    """All inputs of a step except its parameters: memory, time [s], state, and reference now and one period later."""

    memory: StepMemory
    t: Scalar
    state: State
    now: Reference
    following: Reference


def random_samples(
    guard: GuardedStep, trajectory: AbstractTrajectory, period: float, t1: float, count: int, *, seed: int
) -> Sample:
    """Draw samples, with the sample as first axis.

    - `period`, `t1`: sample time, and end of the motion [s].
    """
    keys = jax.random.split(jax.random.key(seed), count)
    first, drawn = _drawn(guard, trajectory, jnp.asarray(period), jnp.asarray(t1), keys)
    # Most have gone through the law for one sample.
    older = np.random.default_rng(seed).random(count) < 0.8
    memory = jax.tree.map(
        lambda a, b: jnp.where(older.reshape(-1, *[1] * (a.ndim - 1)), a, b),
        answer(guard, first)[0].memory,
        first.memory,
    )
    return eqx.tree_at(lambda sample: sample.memory, drawn, memory)


def answer(guard: GuardedStep, samples: Sample) -> tuple[Command, Status]:
    """Return the command and the status of every sample, computed one after the other as in a run."""
    count = len(samples.t)
    arrays = jax.tree.map(np.asarray, samples)
    # Pieces of one size and one dtype, so that the long step is compiled once.
    guard = jax.tree.map(lambda x: jnp.asarray(x, x.dtype), guard)
    pieces = []
    for first in range(0, count, AT_ONCE):
        which = np.minimum(np.arange(first, first + AT_ONCE), count - 1)
        piece = jax.tree.map(lambda x, which=which: jnp.asarray(x[which]), arrays)
        pieces.append(jax.tree.map(np.asarray, _answered(guard, piece)))
    return jax.tree.map(lambda *parts: jnp.asarray(np.concatenate(parts)[:count]), *pieces)


@_compiled_quickly
def _answered(guard: GuardedStep, samples: Sample) -> tuple[Command, Status]:
    def step(sample: Sample) -> tuple[Command, Status]:
        return guard.step(sample.t, sample.state, sample.now, sample.following, sample.memory)

    return jax.lax.map(step, samples)


@_compiled_quickly
def _drawn(
    guard: GuardedStep, trajectory: AbstractTrajectory, period: Scalar, t1: Scalar, keys: Array
) -> tuple[Sample, Sample]:
    """Two consecutive samples for each key, both with the memory before the first."""

    def two(key: Array) -> tuple[Sample, Sample]:
        keys = jax.random.split(key, 4)
        n = guard.joints
        t = period * jnp.floor(jax.random.uniform(keys[0], (), minval=1.0, maxval=t1 / period))
        before, now, following = (trajectory.reference(t + k * period) for k in (-1, 0, 1))
        share = jax.random.uniform(keys[1], (n,), minval=-1.0, maxval=1.0)
        error = _inside(guard, t, before, share)
        rate = jax.random.normal(keys[2], (n,)) * 10.0 ** jax.random.uniform(keys[3], (), minval=-3.0, maxval=1.0)
        # Near its bounds the error decreases, by less than its own size: the next one is inside too.
        rate = jnp.where(jnp.abs(share) > 0.5, -jnp.sign(error) * jnp.abs(rate), rate)
        fastest = 0.2 * jnp.abs(error) / (jnp.abs(share) * period)
        rate = jnp.clip(rate, -fastest, fastest)
        last = State(q=before.q + error, dq=before.dq + rate)
        memory = guard.init(t - period, last, before)
        moved = error + period * rate
        state = State(q=now.q + moved, dq=now.dq + rate)
        return Sample(memory, t - period, last, before, now), Sample(memory, t, state, now, following)

    return jax.lax.map(two, keys)


def _inside(guard: GuardedStep, t: Scalar, reference: Reference, share: Vector) -> Vector:
    """An error at a share of the way to the bounds; without an envelope the way is half a radian or metre."""
    side = State(q=reference.q + 1e-6 * jnp.sign(share), dq=reference.dq)
    envelope = guard.envelope(t, guard.init(t, side, reference))
    if envelope is None:
        return 0.5 * share
    return INSIDE * jnp.where(share > 0, share * envelope.upper, -share * envelope.lower)


def broken(samples: Sample) -> Sample:
    """Return the samples, each with one bad number: not finite, huge or denormal."""

    def places(sample: Sample) -> list[Any]:
        return [sample.t, sample.state.q, sample.state.dq, sample.now.q, sample.following.dq]

    parts = [np.array(x) for x in places(samples)]
    count = len(parts[0])
    rng = np.random.default_rng(count)
    for k in range(count):
        part = parts[rng.choice(len(parts), p=[0.1, 0.4, 0.3, 0.1, 0.1])]
        row = part[k : k + 1].reshape(-1)
        row[rng.integers(row.size)] = BAD_NUMBERS[k % len(BAD_NUMBERS)]
    return eqx.tree_at(places, samples, [jnp.asarray(part) for part in parts])
