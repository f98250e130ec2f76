"""The controller between two steps of MuJoCo by XLA: slower, for laws without machine code, and without llvmlite."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax._types import State, Vector

from ..loop import Carry, Loop, LoopStart
from ..period import force
from ..rollout import begin, decide
from ..run import Log
from ..signature import LoopSignature
from .packing import Packed, Packing
from .world import World


class XlaSteps:
    """The controller's side of a run, as `NativeSteps`."""

    def __init__(self, loop: Loop, state: State, world: World) -> None:
        arrays, static = eqx.partition((loop, state), eqx.is_array)
        self._code = _xla_code(LoopSignature.of(arrays, static, True))
        self._known = self._code.of_loop.pack(arrays[0])
        carry, *self._rest = self._code.begin(self._known, state)
        # By NumPy, which has no weak types: they vanish after one sample, and all would be compiled again.
        self._carry = tuple(jax.device_put(np.asarray(part)) for part in self._code.of_carry.pack(carry))
        self._held = self._code.held
        self._lines: list[Packed] = []
        self._world = world
        self._k = 0
        # Compiled by these calls, before the run.
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
        # Copies: JAX may use NumPy's memory, which changes.
        return self._known, self._carry, self._world.q.copy(), self._world.dq.copy()

    def _force_arguments(self, i: int) -> tuple[Any, ...]:
        return self._known, self._held, self._k, i, self._world.q.copy(), self._world.dq.copy()


@dataclass(frozen=True)
class _XlaCode:
    """Functions of packed arrays, a packed zero torque, and the packings."""

    begin: Callable[..., Any]
    decide: Callable[..., Any]
    force: Callable[..., Any]
    held: Packed
    of_loop: Packing
    of_carry: Packing
    of_log: Packing


@functools.lru_cache(maxsize=16)
def _xla_code(signature: LoopSignature) -> _XlaCode:
    join, arrays = signature.join, signature.arrays
    of_loop = Packing(arrays[0])

    def loop_of(known: Packed) -> Loop:
        return join((of_loop.unpack(known), arrays[1]))[0]

    def start(known: Packed, state: State) -> LoopStart:
        return begin(loop_of(known), state)

    known = eqx.filter_eval_shape(of_loop.pack, arrays[0])
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

    nothing = of_held.pack(jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), held))
    return _XlaCode(jax.jit(start), jax.jit(decide_packed), jax.jit(force_packed), nothing, of_loop, of_carry, of_log)
