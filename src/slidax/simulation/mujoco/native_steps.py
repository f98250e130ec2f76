"""The controller between two steps of MuJoCo, as machine code."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax._types import State
from slidax.codegen import llvm
from slidax.codegen.trace import trace

from ..loop import Loop, LoopStart
from ..period import force
from ..rollout import begin, decide
from ..run import Log
from ..signature import LoopSignature
from .bound import BoundKernel
from .world import World


class NativeSteps:
    """The controller's side of a run.

    - `state`: at t = 0.
    - `world`: its arrays are read and written in place.
    - `rows`: number of logged samples.

    Raises NoNativeCodeError if a part of the loop has no machine code.
    """

    def __init__(self, loop: Loop, state: State, world: World, rows: int) -> None:
        arrays, static = eqx.partition((loop, state), eqx.is_array)
        code = _native_code(LoopSignature.of(arrays, static, True))
        of_loop = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays[0])]
        self._code = code
        leaves = code.begin([*of_loop, *(np.asarray(leaf) for leaf in jax.tree.leaves(arrays[1]))])
        start = jax.tree.unflatten(jax.tree.structure(code.start), leaves)
        self._rest = start[1:]
        # Two carries: each sample reads one and writes the other.
        carries = [jax.tree.map(np.array, start[0]) for _ in range(2)]
        moved = [eqx.tree_at(lambda c: (c.state.q, c.state.dq), carry, (world.q, world.dq)) for carry in carries]
        self._log = jax.tree.map(lambda x: np.zeros((rows + 1, *x.shape), x.dtype), code.log)
        held = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), code.held)
        # x[0] is no array where a line holds one number.
        line = jax.tree.leaves(jax.tree.map(lambda x: x[0, ...], self._log))
        self._decide = [
            BoundKernel(
                code.decide,
                [*of_loop, *jax.tree.leaves(moved[at])],
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
            code.force, [*of_loop, *jax.tree.leaves(held), self._k, self._i, world.q, world.dq], [world.force]
        )
        self._at = 0
        self._kept = 0

    @property
    def start(self) -> LoopStart:
        """The start of the loop, with the present carry."""
        return (self._carries[self._at], *self._rest)

    @property
    def log(self) -> Log:
        """The logged samples."""
        return jax.tree.map(lambda x: x[: self._kept], self._log)

    def decide(self, k: int, keep: bool) -> bool:
        """Decide at sample k, log it if `keep`, and return True if the run continues."""
        self._k[...] = k
        self._decide[self._at]()
        self._at = 1 - self._at
        if keep:
            # Until the next line, each sample overwrites the previous one.
            self._kept += 1
            for kernel in self._decide:
                kernel.shift(self._lines, self._strides)
        return not self._carries[self._at].fault.kind

    def set_force(self, i: int) -> None:
        """Write the force on the joints at the start of substep i after the sample."""
        self._i[...] = i
        self._force()


@dataclass(frozen=True)
class _NativeCode:
    """Kernels, and the results of their functions with shapes for arrays."""

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

    def loop_of(leaves: Any) -> Loop:
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
    """Machine code of a function of arrays, and its result with shapes for arrays."""
    parts: list[Any] = []

    def arrays_of(*args: Any) -> Any:
        arrays, static = eqx.partition(function(*args), eqx.is_array)
        # Recorded during the only trace, since tracing a law takes seconds.
        parts[:] = [jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), arrays), static]
        return arrays

    kernel = llvm.compile(trace(arrays_of, *args, named=False))
    return kernel, eqx.combine(*parts, is_leaf=lambda x: x is None)
