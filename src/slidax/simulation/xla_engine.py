"""The closed loop by XLA: the reference, and the engine for gradients, accelerators and `vmap`."""

from __future__ import annotations

import time
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from slidax._types import State
from slidax.numerics import once

from .loop import Begun, Carry, Inside, Loop
from .progress import Progress
from .rollout import begin, sample
from .run import Log, Timing

CHUNK = 50_000
"""About how many samples pass between two looks at the run: often enough for a bar, and each look costs as much as a
thousand samples."""

_begin = eqx.filter_jit(begin)


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

    def turn(carry: Carry, _: None) -> tuple[Carry, Log]:
        # One array instead of dozens: XLA looks up the address of each in every step.
        same = eqx.combine(unpack(once(packed)), rest) if pack else loop
        # Tied together, so that a run rounds alike whether it is logged or not.
        return jax.lax.optimization_barrier(sample(same, carry))

    def unlogged(carry: Carry, _: None) -> tuple[Carry, None]:
        return turn(carry, None)[0], None

    def group(carry: Carry, _: None) -> tuple[Carry, Log]:
        carry, logs = jax.lax.scan(turn, carry, None, length=every)
        return carry, jax.tree.map(lambda x: x[0], logs)

    if every is None:
        return jax.lax.scan(unlogged, carry, None, length=points)
    return jax.lax.scan(turn if every == 1 else group, carry, None, length=points)


_advance: Any = eqx.filter_jit(advance)


def drive(
    loop: Loop,
    state0: State,
    samples: int,
    every: int | None,
    progress: bool | None,
    started: float,
    inside: Inside,
) -> tuple[Begun, Log | None, Timing]:
    """The loop in chunks of equal size, so that it is compiled once and can be watched.

    - `loop`: what stays the same.
    - `state0`: the state at t = 0.
    - `samples`: how many.
    - `every`: one in how many is logged; None logs none.
    - `progress`: whether a bar is shown; None if the run is long and standard error is a terminal.
    - `started`: when, by `time.perf_counter`.
    - `inside`: refuses a start that is not allowed.
    """
    carry, envelope, reference, held = _begin(loop, state0)
    inside(state0, envelope, reference, held)
    chunks = max(1, round(samples / CHUNK))
    # In continuous mode a loop without a log is compiled otherwise and rounds otherwise (it fuses other products into
    # sums), and the metrics would depend on what is logged. So two lines per chunk are made there, and dropped.
    stride = every or (-(-samples // (2 * chunks)) if loop.continuous else None)
    points = max(2, -(-samples // (chunks * (stride or 1))))
    chunks = -(-samples // (points * (stride or 1)))
    compiled = _advance.lower(loop, carry, points, stride, pack=True).compile()
    ready = time.perf_counter()
    logs = []
    with Progress(chunks, progress) as bar:
        for _ in range(chunks):
            carry, log = compiled(loop, carry, points, stride, pack=True)
            if every is not None:
                logs.append(jax.tree.map(np.asarray, log))
            bar.advance()
            if int(carry.fault.kind):
                break
    log = None
    if every is not None:
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *logs)
        log = jax.tree.map(lambda x: x[whole.valid], whole)
    jax.block_until_ready(carry)
    return (carry, envelope, reference, held), log, Timing(compile_s=ready - started, run_s=time.perf_counter() - ready)
