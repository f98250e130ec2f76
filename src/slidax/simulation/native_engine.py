"""Native engine: the closed loop as machine code, for single runs or batches, on the CPU or a GPU."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax.codegen import cuda, llvm
from slidax.codegen.llvm.vectorise import lower_and_fuse

from .define import require_start
from .engine import EngineResult, Progress, RunRequest
from .loop import LoopStart
from .native_loop import Define, LoopSignature, NativeLoop, batch_loop, duals, lower_loop, single_loop
from .run import Log, RunTiming

CHUNK = 1_000_000
"""Approximate number of samples between two updates of the progress bar."""


def drive(request: RunRequest) -> EngineResult:
    """Run the requested loop as machine code, in chunks, to update the progress bar in between."""
    samples, every = request.samples, request.log_every
    arrays, static = eqx.partition((request.loop, request.state0), eqx.is_array)
    native, code = _compiled(LoopSignature.of(arrays, static, every is not None))
    kernel = code.kernel(samples)
    ready = time.perf_counter()
    stride = every or 1
    chunk = max(1, CHUNK // stride) * stride
    inputs = [*native.consts, *_numbers(arrays)]
    carry = [np.zeros(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(native.start[0])]
    start: list[np.ndarray] = []
    logs: list[list[np.ndarray]] = []
    with Progress(-(-samples // chunk), request.progress) as bar:
        for first in range(0, samples, chunk):
            steps = min(chunk, samples - first)
            counts = [np.asarray(steps), *([] if every is None else [np.asarray(every)]), np.asarray(first == 0)]
            results = kernel([*inputs, *counts, *carry], rows=-(-steps // stride))
            rows, end = _split(native, results)
            logs.append(rows)
            if first == 0:
                require_start(request.loop, request.state0, *_unflatten(native.start, end)[1:])
            start = end if not start else [*end[: len(carry)], *start[len(carry) :]]
            carry = end[: len(carry)]
            bar.advance()
            if int(_unflatten(native.start[0], carry).fault.kind):
                break
    log: Log | None = None
    if every is not None:
        log = _unflatten(native.log, [np.concatenate(rows) for rows in zip(*logs, strict=True)]).without_padding()
    end_of_run: LoopStart = _unflatten(native.start, jax.device_put(start))
    return EngineResult(
        end_of_run, log, RunTiming(compile_s=ready - request.started, run_s=time.perf_counter() - ready)
    )


def drive_batch(
    key: Hashable,
    define: Define,
    shapes: Any,
    varied: Any,
    samples: int,
    every: int | None,
    threads: int | None,
    machine: str = "native",
) -> tuple[Any, Log | None]:
    """Run many loops; return their `LoopStart` and log, in which every array has the run as its first axis.

    - `key`: key of the compiled code; equal keys stand for equal loops, which are compiled only once.
    - `define`: maps one run's varied values to the loop and the state at t = 0.
    - `shapes`: shapes of one run's varied values.
    - `varied`: the varied values as arrays with the run as their first axis.
    - `samples`: number of samples of each run.
    - `every`: n to log every n-th sample; None for no log.
    - `threads`: number of threads on the CPU; None for one per core.
    - `machine`: `native` for the CPU, `cuda` for an NVIDIA GPU.

    Raises NoNativeCodeError if a part of the loop has no machine code, DefinitionError if there is no GPU.
    """
    logged = every is not None
    source = _LoopSource((key, logged, *_shape_key(shapes)), lambda: batch_loop(define, shapes, logged=logged))
    if machine == "native":
        return _run_on_processor(source, [], _numbers(varied), samples, every, threads)
    native, kernel = _compiled_for_card(source)
    return _collect(native, kernel.batch(*_batch_inputs(native, _numbers(varied), samples, every)), every)


def drive_duals(key: Hashable, define: Define, at: Any, directions: Any, samples: int, every: int | None) -> Any:
    """Run one loop with its derivatives in many directions; return its `LoopStart` and its log.

    The carry and the log are `Dual`s; every array has the direction as its first axis. Values that do not depend on the
    direction are computed once for several directions. Other arguments as in `drive_batch`.

    - `at`: the run's varied values.
    - `directions`: tree like `at`, in which every array has the direction as its first axis.

    Raises NoNativeCodeError if a part of the loop has no machine code.
    """
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), at)
    logged = every is not None
    source = _LoopSource(
        (key, "duals", logged, *_shape_key(shapes)),
        lambda: lower_loop(*duals(define), shapes, logged=logged, batch=True, shared=shapes),
    )
    return _run_on_processor(source, _numbers(at), _numbers(directions), samples, every, None)


def _run_on_processor(
    source: _LoopSource,
    shared: list[np.ndarray],
    varied: list[np.ndarray],
    samples: int,
    every: int | None,
    threads: int | None,
) -> tuple[Any, Any]:
    native, code = _compiled_batch(source)
    inputs, runs, rows = _batch_inputs(native, varied, samples, every, shared)
    kernel = code.kernel(samples * -(-runs // code.lanes))
    return _collect(native, kernel.batch(inputs, runs, rows, threads), every)


def _batch_inputs(
    native: NativeLoop,
    varied: list[np.ndarray],
    samples: int,
    every: int | None,
    shared: Sequence[np.ndarray] = (),
) -> tuple[list[np.ndarray], int, int]:
    """Return the arguments of a batch kernel: its inputs, the number of runs, and the number of rows in each log."""
    counts = [np.asarray(samples), *([] if every is None else [np.asarray(every)])]
    return [*native.consts, *shared, *varied, *counts], varied[0].shape[0], -(-samples // (every or 1))


def _collect(native: NativeLoop, results: list[np.ndarray], every: int | None) -> tuple[Any, Any]:
    rows, end = _split(native, results)
    log = None if every is None else _unflatten(native.log, rows)
    return _unflatten(native.start, jax.device_put(end)), log


def _shape_key(shapes: Any) -> tuple[Any, ...]:
    leaves, tree = jax.tree.flatten(shapes)
    return tree, tuple((leaf.shape, leaf.dtype.name) for leaf in leaves)


@dataclass(frozen=True)
class _LoopSource:
    """A function that builds a batch's loop, and its key; sources with equal keys are equal."""

    key: Hashable
    build: Callable[[], NativeLoop] = field(compare=False)


@functools.lru_cache(maxsize=64)
def _compiled_batch(source: _LoopSource) -> tuple[NativeLoop, llvm.ByDemand]:
    native = source.build()
    return native, llvm.ByDemand(native.program, lanes=llvm.LANES)


@functools.lru_cache(maxsize=64)
def _compiled_for_card(source: _LoopSource) -> tuple[NativeLoop, cuda.CudaKernel]:
    """Compile for a GPU, with the correctly rounded operations of the CPU, for bitwise equal results."""
    native = source.build()
    return native, cuda.CudaKernel(lower_and_fuse(native.program))


@functools.lru_cache(maxsize=64)
def _compiled(signature: LoopSignature) -> tuple[NativeLoop, llvm.ByDemand]:
    native = single_loop(signature.join, signature.arrays, logged=signature.logged)
    return native, llvm.ByDemand(native.program)


def _numbers(tree: Any) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def _split(native: NativeLoop, results: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Split the results into the arrays of the log and those of the `LoopStart`."""
    logged = len(jax.tree.leaves(native.log))
    return results[:logged], results[logged:]


def _unflatten(shapes: Any, leaves: list[Any]) -> Any:
    return jax.tree.unflatten(jax.tree.structure(shapes), leaves)
