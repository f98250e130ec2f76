"""MuJoCo engine: machine code or XLA evaluates the law, MuJoCo moves the arm."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax.codegen import llvm
from slidax.codegen.ir import DTYPES
from slidax.codegen.trace.tracing import trace
from slidax.core.types import State, Vector

from .define import require_start
from .engine import EngineResult, Progress, RunRequest, engine_for, native_or_xla
from .loop import Carry, ClosedLoop, LoopStart, begin, decide, force
from .mujoco_model import World, mujoco, quiet
from .native_loop import LoopSignature
from .plant import FreeBody, MujocoPlant
from .run import Log, RunTiming


class BoundKernel:
    """A compiled function for one run, bound to arrays that each call reads and writes in place.

    A call costs less than 1 µs; passing the arrays at each call would cost 20 µs.

    - `kernel`: the compiled function.
    - `inputs`, `outputs`: contiguous arrays in the kernel's order; an output must not also be an input.
    """

    def __init__(self, kernel: llvm.Kernel, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> None:
        for array, entry in zip(inputs, kernel.inputs, strict=True):
            assert array.shape == entry.shape
            assert array.dtype == DTYPES[entry.type]
            assert array.flags.c_contiguous
        # Kept alive: the kernel has only their addresses.
        self._arrays = [*inputs, *outputs]
        self._inputs = len(inputs)
        self._table = np.array([array.ctypes.data for array in self._arrays], np.uintp)
        self._address = self._table.ctypes.data
        self._run = kernel.function

    def __call__(self) -> None:
        self._run(self._address, 1, 0)

    def shift(self, outputs: slice, by: np.ndarray) -> None:
        """Advance the addresses of the selected outputs by `by` [bytes], such as to the next row of a log."""
        self._table[self._inputs :][outputs] += by


class NativeSteps:
    """The closed loop without the plant, as machine code.

    - `state`: the arm's state at t = 0.
    - `world`: the arm in MuJoCo; its arrays are read and written in place.
    - `rows`: number of samples in the log of a complete run.

    Raises NoNativeCodeError if a part of the loop has no machine code.
    """

    def __init__(self, loop: ClosedLoop, state: State, world: World, rows: int) -> None:
        arrays, static = eqx.partition((loop, state), eqx.is_array)
        code = _native_code(LoopSignature.of(arrays, static, True))
        loop_arrays = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays[0])]
        self._code = code
        leaves = code.begin([*loop_arrays, *(np.asarray(leaf) for leaf in jax.tree.leaves(arrays[1]))])
        start = jax.tree.unflatten(jax.tree.structure(code.start), leaves)
        self._rest = start[1:]
        # There are two copies of the loop's state (`Carry`), since each sample reads one and writes the other.
        carries = [jax.tree.map(np.array, start[0]) for _ in range(2)]
        moved = [eqx.tree_at(lambda c: (c.state.q, c.state.dq), carry, (world.q, world.dq)) for carry in carries]
        self._log = jax.tree.map(lambda x: np.zeros((rows + 1, *x.shape), x.dtype), code.log)
        held = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), code.held)
        # Unlike x[0], x[0, ...] is an array also for a scalar.
        line = jax.tree.leaves(jax.tree.map(lambda x: x[0, ...], self._log))
        self._decide = [
            BoundKernel(
                code.decide,
                [*loop_arrays, *jax.tree.leaves(moved[at])],
                [*jax.tree.leaves(carries[1 - at]), *line, *jax.tree.leaves(held)],
            )
            for at in range(2)
        ]
        first = len(jax.tree.leaves(carries[0]))
        self._lines = slice(first, first + len(line))
        self._strides = np.array([x.strides[0] for x in jax.tree.leaves(self._log)], np.uintp)
        self._carries = carries
        self._k, self._i = np.zeros((), int), np.zeros((), int)
        self._force = BoundKernel(
            code.force, [*loop_arrays, *jax.tree.leaves(held), self._k, self._i, world.q, world.dq], [world.force]
        )
        self._current = 0
        self._logged = 0

    @property
    def start(self) -> LoopStart:
        """The loop's current state (`Carry`), then envelope, reference and holding torque at t = 0."""
        return (self._carries[self._current], *self._rest)

    @property
    def log(self) -> Log:
        """The logged samples."""
        return jax.tree.map(lambda x: x[: self._logged], self._log)

    def decide(self, k: int, keep: bool) -> bool:
        """Evaluate the law at sample k, log it if `keep`, and return True if the run continues."""
        self._k[...] = k
        self._decide[self._current]()
        self._current = 1 - self._current
        if keep:
            # Move to the next row of the log. Samples that are not kept overwrite the current row.
            self._logged += 1
            for kernel in self._decide:
                kernel.shift(self._lines, self._strides)
        return not self._carries[self._current].fault.kind

    def set_force(self, i: int) -> None:
        """Write the force on the joints at the start of substep i after the latest sample to `world.force`."""
        self._i[...] = i
        self._force()


@dataclass(frozen=True)
class _NativeCode:
    """Kernels of `begin`, `decide` and `force`, and the trees of their results, with shapes instead of arrays."""

    begin: llvm.Kernel
    decide: llvm.Kernel
    force: llvm.Kernel
    start: Any
    log: Any
    held: Any


@functools.lru_cache(maxsize=16)
def _native_code(signature: LoopSignature) -> _NativeCode:
    join = signature.join
    arrays = signature.arrays

    def loop_of(leaves: Any) -> ClosedLoop:
        return join((leaves, arrays[1]))[0]

    begin_code, start = _kernel(lambda leaves, state: begin(loop_of(leaves), state), *arrays)
    decide_code, (_, log, held) = _kernel(lambda leaves, carry: decide(loop_of(leaves), carry), arrays[0], start[0])
    number = jax.ShapeDtypeStruct((), int)
    force_code, _ = _kernel(
        lambda leaves, held, k, i, state: force(loop_of(leaves), held, k, i, state),
        *(arrays[0], held, number, number, arrays[1]),
    )
    return _NativeCode(begin_code, decide_code, force_code, start, log, held)


def _kernel(function: Callable[..., Any], *args: Any) -> tuple[llvm.Kernel, Any]:
    """Compile a function of arrays; return the kernel, and the function's result with shapes instead of arrays."""
    parts: list[Any] = []

    def arrays_of(*args: Any) -> Any:
        arrays, static = eqx.partition(function(*args), eqx.is_array)
        # The shapes are recorded during the only trace, since tracing a law takes seconds.
        parts[:] = [jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), arrays), static]
        return arrays

    kernel = llvm.compile(trace(arrays_of, *args, named=False))
    return kernel, eqx.combine(*parts, is_leaf=lambda x: x is None)


Packed = tuple[Any, ...]
"""A tree's arrays: one array with all floating-point values, then the other arrays."""


class Packing:
    """Conversion of a pytree to few arrays and back: all floating-point leaves become one array.

    - `shapes`: the pytree, with shapes instead of arrays.
    """

    def __init__(self, shapes: Any) -> None:
        leaves, self._tree = jax.tree.flatten(shapes)
        self._real = [np.issubdtype(leaf.dtype, np.floating) for leaf in leaves]
        self._shapes = [leaf.shape for leaf in leaves]
        sizes = [int(np.prod(leaf.shape)) for leaf, real in zip(leaves, self._real, strict=True) if real]
        self._ends = np.cumsum(sizes).tolist()

    def pack(self, tree: Any) -> Packed:
        leaves = list(zip(jax.tree.leaves(tree), self._real, strict=True))
        numbers = jnp.concatenate([jnp.ravel(leaf) for leaf, real in leaves if real])
        return numbers, *(leaf for leaf, real in leaves if not real)

    def unpack(self, packed: Packed) -> Any:
        """Return the tree; the packed arrays may have additional leading axes."""
        numbers, *others = packed
        starts = [0, *self._ends]
        real = (numbers[..., start:end] for start, end in zip(starts, self._ends, strict=False))
        rest = iter(others)
        before = numbers.shape[:-1]
        leaves = [
            next(real).reshape((*before, *shape)) if is_real else next(rest)
            for shape, is_real in zip(self._shapes, self._real, strict=True)
        ]
        return jax.tree.unflatten(self._tree, leaves)


class XlaSteps:
    """The closed loop without the plant, by XLA, with the methods of `NativeSteps`."""

    def __init__(self, loop: ClosedLoop, state: State, world: World) -> None:
        arrays, static = eqx.partition((loop, state), eqx.is_array)
        self._code = _xla_code(LoopSignature.of(arrays, static, True))
        self._known = self._code.loop_arrays.pack(arrays[0])
        carry, *self._rest = self._code.begin(self._known, state)
        # NumPy removes weak types. Otherwise JAX would lose them after one sample, and compile everything again.
        self._carry = tuple(jax.device_put(np.asarray(part)) for part in self._code.of_carry.pack(carry))
        self._held = self._code.held
        self._lines: list[Packed] = []
        self._world = world
        self._k = 0
        # The first calls compile the functions, before the run.
        self._code.decide(*self._decide_arguments)
        self._code.force(*self._force_arguments(0))

    @property
    def start(self) -> LoopStart:
        return (self._code.of_carry.unpack(self._carry), *self._rest)

    @property
    def log(self) -> Log:
        return self._code.of_log.unpack(tuple(np.stack(column) for column in zip(*self._lines, strict=True)))

    def decide(self, k: int, keep: bool) -> bool:
        self._k = k
        self._carry, line, self._held, fault = self._code.decide(*self._decide_arguments)
        if keep:
            self._lines.append(tuple(np.asarray(part) for part in line))
        return not int(fault)

    def set_force(self, i: int) -> None:
        self._world.force[:] = self._code.force(*self._force_arguments(i))

    @property
    def _decide_arguments(self) -> tuple[Any, ...]:
        # Copies, since JAX may share NumPy's memory, which changes.
        return self._known, self._carry, self._world.q.copy(), self._world.dq.copy()

    def _force_arguments(self, i: int) -> tuple[Any, ...]:
        return self._known, self._held, self._k, i, self._world.q.copy(), self._world.dq.copy()


@dataclass(frozen=True)
class _XlaCode:
    """Jitted `begin`, `decide` and `force` for packed arrays, a packed zero torque, and the layouts of the arrays."""

    begin: Callable[..., Any]
    decide: Callable[..., Any]
    force: Callable[..., Any]
    held: Packed
    loop_arrays: Packing
    of_carry: Packing
    of_log: Packing


@functools.lru_cache(maxsize=16)
def _xla_code(signature: LoopSignature) -> _XlaCode:
    join, arrays = signature.join, signature.arrays
    loop_arrays = Packing(arrays[0])

    def loop_of(known: Packed) -> ClosedLoop:
        return join((loop_arrays.unpack(known), arrays[1]))[0]

    def start(known: Packed, state: State) -> LoopStart:
        return begin(loop_of(known), state)

    known = eqx.filter_eval_shape(loop_arrays.pack, arrays[0])
    carry = eqx.filter_eval_shape(start, known, arrays[1])[0]
    _, log, held = eqx.filter_eval_shape(lambda known, carry: decide(loop_of(known), carry), known, carry)
    of_carry, of_log, of_held = Packing(carry), Packing(log), Packing(held)

    def decide_packed(known: Packed, packed: Packed, q: Vector, dq: Vector) -> tuple[Packed, Packed, Packed, Array]:
        before: Carry = of_carry.unpack(packed)
        moved = eqx.tree_at(lambda carry: carry.state, before, State(q=q, dq=dq))
        after, log, held = decide(loop_of(known), moved)
        return of_carry.pack(after), of_log.pack(log), of_held.pack(held), after.fault.kind

    def force_packed(known: Packed, held: Packed, k: Array, i: Array, q: Vector, dq: Vector) -> Vector:
        return force(loop_of(known), of_held.unpack(held), k, i, State(q=q, dq=dq))

    zero = of_held.pack(jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), held))
    return _XlaCode(jax.jit(start), jax.jit(decide_packed), jax.jit(force_packed), zero, loop_arrays, of_carry, of_log)


CHUNK = 1_000
"""Number of samples between two updates of the progress bar."""


def drive(plant: MujocoPlant, engine: str, request: RunRequest) -> EngineResult:
    """Run a loop in held mode: an engine evaluates the law, and MuJoCo moves the arm instead of slidax's own plant.

    - `plant`: the arm and its surroundings.
    - `engine`: requested name of the engine that evaluates the law, such as `auto`.
    - `request`: the loop; its plant must be `plant.with_friction`, which adds the friction that MuJoCo omits.

    Raises DefinitionError if MuJoCo is missing or rejects the arm, or the initial state is invalid; NoNativeCodeError
    if `engine` is `native` and a part of the law has no machine code.
    """
    loop, state0, samples, every = request.loop, request.state0, request.samples, request.log_every
    period, substeps = float(loop.period), loop.substeps
    # The times are bitwise those of slidax's own plant.
    h = period / substeps
    with quiet():
        world = World(plant, h, state0)
        steps: Any = native_or_xla(
            engine,
            engine_for(engine),
            lambda: NativeSteps(loop, state0, world, request.rows),
            lambda: XlaSteps(loop, state0, world),
            stacklevel=5,
        )
        require_start(loop, state0, *steps.start[1:])
        ready = time.perf_counter()
        poses: list[tuple[float, np.ndarray]] = []
        with Progress(-(-samples // CHUNK), request.progress) as bar:
            for k in range(samples):
                t = k * period
                keep = every is not None and k % every == 0
                world.advance_to(t)
                pose = world.body if keep else None
                if pose is not None:
                    poses.append((t, pose))
                running = steps.decide(k, keep)
                if (k + 1) % CHUNK == 0:
                    bar.advance()
                if not running or k == samples - 1:
                    break
                for i in range(substeps):
                    steps.set_force(i)
                    world.step(t + i * h)
    log = None if every is None else steps.log.without_padding()
    start: LoopStart = jax.tree.map(jax.device_put, steps.start)
    timing = RunTiming(compile_s=ready - request.started, run_s=time.perf_counter() - ready)
    return EngineResult(start, log, timing, _load_motion(poses))


def _load_motion(poses: list[tuple[float, np.ndarray]]) -> FreeBody | None:
    if not poses:
        return None
    rotation = np.empty((len(poses), 9))
    for row, (_, pose) in zip(rotation, poses, strict=True):
        mujoco().mju_quat2Mat(row, pose[3:])
    return FreeBody(
        t=np.array([t for t, _ in poses]),
        rotation=rotation.reshape(-1, 3, 3),
        position=np.stack([pose[:3] for _, pose in poses]),
    )
