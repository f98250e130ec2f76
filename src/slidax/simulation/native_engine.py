"""The closed loop as machine code of its own: single runs on the processor, batches there or on a card."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import equinox as eqx
import jax
import numpy as np

from slidax._types import State
from slidax.codegen import cuda, llvm
from slidax.codegen.llvm.prepare import lowered_and_fused

from .duals import duals
from .loop import Begun, Inside, Loop
from .native_loop import Define, NativeLoop, batch_loop, lowered, single_loop
from .progress import Progress
from .run import Log, Timing
from .signature import LoopSignature

OurOwn = Literal["native", "cuda"]
"""Where code of our own runs: on the processor, or on an NVIDIA card."""

CHUNK = 1_000_000
"""About how many samples pass between two looks at the run, for its bar."""


def drive(
    loop: Loop,
    state0: State,
    samples: int,
    every: int | None,
    progress: bool | None,
    started: float,
    inside: Inside,
) -> tuple[Begun, Log | None, Timing]:
    """The carry at the end, with envelope and reference at the beginning, and the log.

    - `loop`: what stays the same.
    - `state0`: the state at t = 0.
    - `samples`: how many.
    - `every`: one in how many is logged; None logs none.
    - `progress`: whether a bar is shown; None if the run is long and standard error is a terminal.
    - `started`: when, by `time.perf_counter`.
    - `inside`: refuses a start that is not allowed.

    Raises NoNativeCodeError if there is no machine code for something in it.
    """
    arrays, static = eqx.partition((loop, state0), eqx.is_array)
    native, code = _compiled(LoopSignature.of(arrays, static, every is not None))
    kernel = code.kernel(samples)
    ready = time.perf_counter()
    stride = every or 1
    chunk = max(1, CHUNK // stride) * stride
    known = [*native.consts, *_numbers(arrays)]
    carry = [np.zeros(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(native.begun[0])]
    begun: list[np.ndarray] = []
    logs: list[list[np.ndarray]] = []
    with Progress(-(-samples // chunk), progress) as bar:
        for first in range(0, samples, chunk):
            steps = min(chunk, samples - first)
            how = [np.asarray(steps), *([] if every is None else [np.asarray(every)]), np.asarray(first == 0)]
            results = kernel([*known, *how, *carry], rows=-(-steps // stride))
            logged, left = _split(native, results)
            logs.append(logged)
            if first == 0:
                inside(state0, *_unflattened(native.begun, left)[1:])
            begun = left if not begun else [*left[: len(carry)], *begun[len(carry) :]]
            carry = left[: len(carry)]
            bar.advance()
            if int(_unflattened(native.begun[0], carry).fault.kind):
                break
    log = None
    if every is not None:
        whole = _unflattened(native.log, [np.concatenate(parts) for parts in zip(*logs, strict=True)])
        log = jax.tree.map(lambda x: x[whole.valid], whole)
    ended: Begun = _unflattened(native.begun, jax.device_put(begun))
    return ended, log, Timing(compile_s=ready - started, run_s=time.perf_counter() - ready)


def drive_batch(
    task: Hashable,
    define: Define,
    one: Any,
    varied: Any,
    samples: int,
    every: int | None,
    threads: int | None,
    on: OurOwn = "native",
) -> tuple[Any, Log | None]:
    """The same for many runs; every array has the run as its first axis, also the `Begun` that comes first.

    - `task`: equal for equal loops, so that each is compiled once.
    - `define`: from what varies, for one run, to the loop and the first state.
    - `one`: the shapes of what varies, for one run.
    - `varied`: arrays with the run as their first axis.
    - `samples`: how many.
    - `every`: one in how many is logged; None logs none.
    - `threads`: how many; None: as many as there are cores. A card has its own.
    - `on`: where they run.

    Raises NoNativeCodeError if there is no machine code for something in it, DefinitionError if there is no card.
    """
    logged = every is not None
    known = _Known((task, *_form(one)), lambda: batch_loop(define, one, logged=logged), logged)
    if on == "native":
        return _driven(known, [], _numbers(varied), samples, every, threads)
    native, kernel = _compiled_for_card(known)
    return _collected(native, kernel.batch(*_asked(native, _numbers(varied), samples, every)), every)


def drive_duals(task: Hashable, define: Define, at: Any, directions: Any, samples: int, every: int | None) -> Any:
    """One loop, and how it changes in many directions: pairs of numbers and derivatives, direction by direction.

    What does not depend on the direction is computed once for several.

    - `task`, `define`, `samples`, `every`: as in `drive_batch`.
    - `at`: what varies.
    - `directions`: trees like `at` with the direction as their first axis.

    Raises NoNativeCodeError if there is no machine code for something in it.
    """
    one = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), at)
    known = _Known(
        (task, "duals", *_form(one)),
        lambda: lowered(*duals(define), one, logged=every is not None, batch=True, shared=one),
        every is not None,
    )
    return _driven(known, _numbers(at), _numbers(directions), samples, every, None)


def _driven(
    known: _Known,
    shared: list[np.ndarray],
    varied: list[np.ndarray],
    samples: int,
    every: int | None,
    threads: int | None,
) -> tuple[Any, Any]:
    native, code = _compiled_batch(known)
    inputs, runs, rows = _asked(native, varied, samples, every, shared)
    kernel = code.kernel(samples * -(-runs // code.lanes))
    return _collected(native, kernel.batch(inputs, runs, rows, threads), every)


def _asked(
    native: NativeLoop,
    varied: list[np.ndarray],
    samples: int,
    every: int | None,
    shared: Sequence[np.ndarray] = (),
) -> tuple[list[np.ndarray], int, int]:
    """What a kernel is given: its inputs, how many runs, and how many rows of the log."""
    how = [np.asarray(samples), *([] if every is None else [np.asarray(every)])]
    return [*native.consts, *shared, *varied, *how], varied[0].shape[0], -(-samples // (every or 1))


def _collected(native: NativeLoop, results: list[np.ndarray], every: int | None) -> tuple[Any, Any]:
    logged, left = _split(native, results)
    log = None if every is None else _unflattened(native.log, logged)
    ended = _unflattened(native.begun, jax.device_put(left))
    return ended, log


def _form(one: Any) -> tuple[Any, ...]:
    leaves, tree = jax.tree.flatten(one)
    return tree, tuple((leaf.shape, leaf.dtype.name) for leaf in leaves)


@dataclass(frozen=True)
class _Known:
    """A batch's loop, equal to others by its key alone."""

    key: Hashable
    make: Callable[[], NativeLoop] = field(compare=False)
    logged: bool


@functools.lru_cache(maxsize=64)
def _compiled_batch(known: _Known) -> tuple[NativeLoop, llvm.ByDemand]:
    native = known.make()
    return native, llvm.ByDemand(native.program, lanes=llvm.LANES)


@functools.lru_cache(maxsize=64)
def _compiled_for_card(known: _Known) -> tuple[NativeLoop, cuda.Kernel]:
    """The program in the very operations that the processor gets, all of them exactly rounded, so in the same bits."""
    native = known.make()
    return native, cuda.compile(lowered_and_fused(native.program))


@functools.lru_cache(maxsize=64)
def _compiled(signature: LoopSignature) -> tuple[NativeLoop, llvm.ByDemand]:
    native = single_loop(signature.whole, signature.arrays, logged=signature.logged)
    return native, llvm.ByDemand(native.program)


def _numbers(tree: Any) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def _split(native: NativeLoop, results: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    logged = len(jax.tree.leaves(native.log))
    return results[:logged], results[logged:]


def _unflattened(shapes: Any, leaves: list[Any]) -> Any:
    return jax.tree.unflatten(jax.tree.structure(shapes), leaves)
