"""What the controller does between two steps of MuJoCo, as machine code of our own."""

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

from ..loop import Begun, Loop
from ..period import force
from ..rollout import begin, decide
from ..run import Log
from ..signature import LoopSignature
from .bound import Bound
from .world import World


class NativeSteps:
    """The controller's side of a run.

    - `loop`: what stays the same.
    - `state`: at t = 0.
    - `world`: what moves; its arrays are read and written where they are.
    - `rows`: how many samples are logged.

    Raises NoNativeCodeError if there is no machine code for something in it.
    """

    def __init__(self, loop: Loop, state: State, world: World, rows: int) -> None:
        arrays, static = eqx.partition((loop, state), eqx.is_array)
        code = _compiled(LoopSignature.of(arrays, static, True))
        of_loop = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays[0])]
        self._code = code
        started = code.begin([*of_loop, *(np.asarray(leaf) for leaf in jax.tree.leaves(arrays[1]))])
        begun = jax.tree.unflatten(jax.tree.structure(code.begun), started)
        self._rest = begun[1:]
        # The carry in two places, and each sample goes from one to the other.
        carries = [jax.tree.map(np.array, begun[0]) for _ in range(2)]
        seen = [eqx.tree_at(lambda c: (c.state.q, c.state.dq), carry, (world.q, world.dq)) for carry in carries]
        self._log = jax.tree.map(lambda x: np.zeros((rows + 1, *x.shape), x.dtype), code.log)
        held = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), code.held)
        # Not x[0], which is no array where a line holds one number.
        line = jax.tree.leaves(jax.tree.map(lambda x: x[0, ...], self._log))
        self._decide = [
            Bound(
                code.decide,
                [*of_loop, *jax.tree.leaves(seen[at])],
                [*jax.tree.leaves(carries[1 - at]), *line, *jax.tree.leaves(held)],
            )
            for at in range(2)
        ]
        first = len(jax.tree.leaves(carries[0]))
        self._lines = slice(first, first + len(line))
        self._strides = np.array([x.strides[0] for x in jax.tree.leaves(self._log)], np.uintp)
        self._carries = carries
        self._k, self._i = np.zeros((), int), np.zeros((), int)
        self._force = Bound(
            code.force, [*of_loop, *jax.tree.leaves(held), self._k, self._i, world.q, world.dq], [world.force]
        )
        self._at = 0
        self._kept = 0

    @property
    def begun(self) -> Begun:
        """The carry as it is now, with envelope and reference at the beginning."""
        return (self._carries[self._at], *self._rest)

    @property
    def log(self) -> Log:
        """The lines that were kept."""
        return jax.tree.map(lambda x: x[: self._kept], self._log)

    def decide(self, k: int, keep: bool) -> bool:
        """One sample; returns whether the run goes on.

        - `k`: its number.
        - `keep`: whether its line is kept.
        """
        self._k[...] = k
        self._decide[self._at]()
        self._at = 1 - self._at
        if keep:
            # The next sample writes on the next line; until then each writes over the one before it.
            self._kept += 1
            for each in self._decide:
                each.shift(self._lines, self._strides)
        return not self._carries[self._at].fault.kind

    def push(self, i: int) -> None:
        """Writes what pushes the joints at the start of a substep.

        - `i`: its number after the sample.
        """
        self._i[...] = i
        self._force()


@dataclass(frozen=True)
class _Code:
    """The kernels, and the results of the functions with shapes for arrays."""

    begin: llvm.Kernel
    decide: llvm.Kernel
    force: llvm.Kernel
    begun: Any
    log: Any
    held: Any


@functools.lru_cache(maxsize=16)
def _compiled(signature: LoopSignature) -> _Code:
    whole = signature.whole
    arrays = signature.arrays

    def of_loop(given: Any) -> Loop:
        return whole((given, arrays[1]))[0]

    begin_code, begun = _kernel(lambda given, start: begin(of_loop(given), start), *arrays)
    decide_code, (_, log, held) = _kernel(lambda given, carry: decide(of_loop(given), carry), arrays[0], begun[0])
    number = jax.ShapeDtypeStruct((), int)
    force_code, _ = _kernel(
        lambda given, held, k, i, state: force(of_loop(given), held, k, i, state),
        *(arrays[0], held, number, number, arrays[1]),
    )
    return _Code(begin_code, decide_code, force_code, begun, log, held)


def _kernel(function: Callable[..., Any], *args: Any) -> tuple[llvm.Kernel, Any]:
    """The machine code of a function of arrays, and its result with shapes for arrays."""
    found: list[Any] = []

    def arrays_of(*args: Any) -> Any:
        arrays, static = eqx.partition(function(*args), eqx.is_array)
        # Seen while it is traced: to trace a law takes seconds.
        found[:] = [jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), arrays), static]
        return arrays

    kernel = llvm.compile(trace(arrays_of, *args, named=False))
    return kernel, eqx.combine(*found, is_leaf=lambda x: x is None)
