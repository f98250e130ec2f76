"""XLA engine: the reference engine, also for gradients, accelerators and `vmap`."""

from __future__ import annotations

import time
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from slidax.core.tracing import barrier

from .define import require_start
from .engine import EngineResult, Progress, RunRequest
from .loop import Carry, ClosedLoop, LoopStart, begin, sample
from .run import Log, RunTiming

CHUNK = 50_000
"""Approximate number of samples between two updates of the progress bar; each costs as much as a thousand samples."""

_begin = eqx.filter_jit(begin)


def advance(loop: ClosedLoop, carry: Carry, points: int, every: int | None, *, pack: bool) -> tuple[Carry, Log | None]:
    """Return the loop's carry after `points * (every or 1)` samples, and the log of every `every`-th sample.

    - `points`: number of rows in the log; without a log, the number of samples.
    - `every`: n to log every n-th sample; None for no log.
    - `pack`: True to pass the loop's arrays as one array. This is faster for a single run. In a batch, it prevents the
      runs from sharing equal values.
    """
    arrays, rest = eqx.partition(loop, eqx.is_inexact_array)
    packed, unpack = ravel_pytree(arrays)

    def advance_sample(carry: Carry, _: None) -> tuple[Carry, Log]:
        # One array instead of dozens, since XLA looks up the address of each in every step.
        unpacked = eqx.combine(unpack(barrier(packed)), rest) if pack else loop
        # The barrier makes a run with a log round like a run without one.
        return jax.lax.optimization_barrier(sample(unpacked, carry))

    def unlogged(carry: Carry, _: None) -> tuple[Carry, None]:
        return advance_sample(carry, None)[0], None

    def group(carry: Carry, _: None) -> tuple[Carry, Log]:
        carry, logs = jax.lax.scan(advance_sample, carry, None, length=every)
        return carry, jax.tree.map(lambda x: x[0], logs)

    if every is None:
        return jax.lax.scan(unlogged, carry, None, length=points)
    return jax.lax.scan(advance_sample if every == 1 else group, carry, None, length=points)


_advance: Any = eqx.filter_jit(advance)


def drive(request: RunRequest) -> EngineResult:
    """Run the requested loop by XLA, in chunks of equal size, to update the progress bar in between."""
    loop, samples, every = request.loop, request.samples, request.log_every
    start: LoopStart = _begin(loop, request.state0)
    require_start(loop, request.state0, *start[1:])
    carry = start[0]
    chunks = max(1, round(samples / CHUNK))
    # In continuous mode, a loop without a log would round differently, since XLA fuses other products into sums.
    # Metrics would then depend on logging. Therefore each chunk logs at least two samples, which are dropped.
    stride = every or (-(-samples // (2 * chunks)) if loop.continuous else None)
    points = max(2, -(-samples // (chunks * (stride or 1))))
    chunks = -(-samples // (points * (stride or 1)))
    compiled = _advance.lower(loop, carry, points, stride, pack=True).compile()
    ready = time.perf_counter()
    logs = []
    with Progress(chunks, request.progress) as bar:
        for _ in range(chunks):
            carry, log = compiled(loop, carry, points, stride, pack=True)
            if every is not None:
                logs.append(jax.tree.map(np.asarray, log))
            bar.advance()
            if int(carry.fault.kind):
                break
    log = jax.tree.map(lambda *parts: np.concatenate(parts), *logs).without_padding() if logs else None
    jax.block_until_ready(carry)
    timing = RunTiming(compile_s=ready - request.started, run_s=time.perf_counter() - ready)
    return EngineResult((carry, *start[1:]), log, timing)
