"""Samples drawn at random: anywhere inside the envelope, moving anyhow, with a memory that fits; and bad ones."""

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
"""How near to its bounds an error is drawn."""

BAD = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 5e-324, -1e-310)
"""What a sensor should not say."""

AT_ONCE = 100
"""Samples that are answered by one call."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

QUICKLY = {"xla_backend_optimization_level": 0}
"""A few hundred samples need no fast code, and making it takes four times as long."""


def _compiled_quickly(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    jit: Any = eqx.filter_jit
    return jit(function, compiler_options=QUICKLY)


class Sample(eqx.Module):
    """All that a step reads beside its parameters.

    - `memory`: what is kept from before.
    - `t`: time [s].
    - `state`: measured positions and velocities.
    - `now`, `following`: what the joints should do now and one period later.
    """

    memory: StepMemory
    t: Scalar
    state: State
    now: Reference
    following: Reference


def random_samples(
    guard: GuardedStep, trajectory: AbstractTrajectory, period: float, t1: float, count: int, *, seed: int
) -> Sample:
    """Samples with the number of the sample as first axis.

    - `guard`: the step.
    - `trajectory`: what the joints should do.
    - `period`: time between two samples [s].
    - `t1`: end of the motion [s].
    - `count`: how many.
    - `seed`: another seed draws others.
    """
    keys = jax.random.split(jax.random.key(seed), count)
    first, drawn = _drawn(guard, trajectory, jnp.asarray(period), jnp.asarray(t1), keys)
    # Most have been in the law for a sample.
    older = np.random.default_rng(seed).random(count) < 0.8
    memory = jax.tree.map(
        lambda a, b: jnp.where(older.reshape(-1, *[1] * (a.ndim - 1)), a, b),
        answer(guard, first)[0].memory,
        first.memory,
    )
    return eqx.tree_at(lambda sample: sample.memory, drawn, memory)


def answer(guard: GuardedStep, samples: Sample) -> tuple[Command, Status]:
    """The command and the status of every sample, one after the other as in a run.

    - `guard`: the step.
    - `samples`: with the number of the sample as first axis.
    """
    count = len(samples.t)
    given = jax.tree.map(np.asarray, samples)
    # Pieces of one size, and numbers of one kind: so the step, which is long, is compiled once.
    guard = jax.tree.map(lambda x: jnp.asarray(x, x.dtype), guard)
    pieces = []
    for first in range(0, count, AT_ONCE):
        which = np.minimum(np.arange(first, first + AT_ONCE), count - 1)
        piece = jax.tree.map(lambda x, which=which: jnp.asarray(x[which]), given)
        pieces.append(jax.tree.map(np.asarray, _answered(guard, piece)))
    return jax.tree.map(lambda *parts: jnp.asarray(np.concatenate(parts)[:count]), *pieces)


@_compiled_quickly
def _answered(guard: GuardedStep, samples: Sample) -> tuple[Command, Status]:
    def one(sample: Sample) -> tuple[Command, Status]:
        return guard.step(sample.t, sample.state, sample.now, sample.following, sample.memory)

    return jax.lax.map(one, samples)


@_compiled_quickly
def _drawn(
    guard: GuardedStep, trajectory: AbstractTrajectory, period: Scalar, t1: Scalar, keys: Array
) -> tuple[Sample, Sample]:
    """Two samples in a row for each key, both with the memory before the first."""

    def two(key: Array) -> tuple[Sample, Sample]:
        keys = jax.random.split(key, 4)
        n = guard.joints
        t = period * jnp.floor(jax.random.uniform(keys[0], (), minval=1.0, maxval=t1 / period))
        before, now, following = (trajectory.reference(t + k * period) for k in (-1, 0, 1))
        share = jax.random.uniform(keys[1], (n,), minval=-1.0, maxval=1.0)
        error = _inside(guard, t, before, share)
        rate = jax.random.normal(keys[2], (n,)) * 10.0 ** jax.random.uniform(keys[3], (), minval=-3.0, maxval=1.0)
        # Near to its bounds the error decreases, and never by more than a part of it: the next one is inside, too.
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
    """An error that is a share of the way to the bounds; half a radian or metre is all the way where there are none."""
    side = State(q=reference.q + 1e-6 * jnp.sign(share), dq=reference.dq)
    envelope = guard.envelope(t, guard.init(t, side, reference))
    if envelope is None:
        return 0.5 * share
    return INSIDE * jnp.where(share > 0, share * envelope.upper, -share * envelope.lower)


def broken(samples: Sample) -> Sample:
    """The same samples, each with one number that is bad: not finite, huge or denormal.

    - `samples`: with the number of the sample as first axis.
    """

    def places(sample: Sample) -> list[Any]:
        return [sample.t, sample.state.q, sample.state.dq, sample.now.q, sample.following.dq]

    parts = [np.array(x) for x in places(samples)]
    count = len(parts[0])
    rng = np.random.default_rng(count)
    for k in range(count):
        part = parts[rng.choice(len(parts), p=[0.1, 0.4, 0.3, 0.1, 0.1])]
        row = part[k : k + 1].reshape(-1)
        row[rng.integers(row.size)] = BAD[k % len(BAD)]
    return eqx.tree_at(places, samples, [jnp.asarray(part) for part in parts])
