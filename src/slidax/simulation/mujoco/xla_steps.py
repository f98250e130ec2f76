"""The same by XLA: slower, for laws without machine code of ours and where llvmlite is missing."""

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

from ..loop import Begun, Carry, Loop
from ..period import force
from ..rollout import begin, decide
from ..run import Log
from ..signature import LoopSignature
from .packing import Packed, Packing
from .world import World


class XlaSteps:
    """The controller's side of a run.

    - `loop`: what stays the same.
    - `state`: at t = 0.
    - `world`: what moves.
    """

    def __init__(self, loop: Loop, state: State, world: World) -> None:
        arrays, static = eqx.partition((loop, state), eqx.is_array)
        self._code = _compiled(LoopSignature.of(arrays, static, True))
        self._known = self._code.of_loop.pack(arrays[0])
        carry, *self._rest = self._code.begin(self._known, state)
        # By NumPy, which knows no weak types: they are gone after one sample, and all would be compiled again.
        self._carry = tuple(jax.device_put(np.asarray(part)) for part in self._code.of_carry.pack(carry))
        self._held = self._code.held
        self._lines: list[Packed] = []
        self._world = world
        self._k = 0
        # Called for nothing, so that they are compiled now and not within the run.
        self._code.decide(*self._decided)
        self._code.force(*self._pushed(0))

    @property
    def begun(self) -> Begun:
        """The carry as it is now, with envelope and reference at the beginning."""
        return (self._code.of_carry.unpack(self._carry), *self._rest)

    @property
    def log(self) -> Log:
        """The lines that were kept."""
        return self._code.of_log.unpack(tuple(np.stack(column) for column in zip(*self._lines, strict=True)))

    def decide(self, k: int, keep: bool) -> bool:
        """One sample; returns whether the run goes on.

        - `k`: its number.
        - `keep`: whether its line is kept.
        """
        self._k = k
        self._carry, line, self._held, fault = self._code.decide(*self._decided)
        if keep:
            self._lines.append(tuple(np.asarray(part) for part in line))
        return not int(fault)

    def push(self, i: int) -> None:
        """Writes what pushes the joints at the start of a substep.

        - `i`: its number after the sample.
        """
        self._world.force[:] = self._code.force(*self._pushed(i))

    @property
    def _decided(self) -> tuple[Any, ...]:
        # Copies: where it can, JAX takes NumPy's memory, which changes.
        return self._known, self._carry, self._world.q.copy(), self._world.dq.copy()

    def _pushed(self, i: int) -> tuple[Any, ...]:
        return self._known, self._held, self._k, i, self._world.q.copy(), self._world.dq.copy()


@dataclass(frozen=True)
class _Code:
    """The functions, of packed arrays, what stands for the held torque before there is one, and what is packed how."""

    begin: Callable[..., Any]
    decide: Callable[..., Any]
    force: Callable[..., Any]
    held: Packed
    of_loop: Packing
    of_carry: Packing
    of_log: Packing


@functools.lru_cache(maxsize=16)
def _compiled(signature: LoopSignature) -> _Code:
    whole, arrays = signature.whole, signature.arrays
    of_loop = Packing(arrays[0])

    def loop_of(known: Packed) -> Loop:
        return whole((of_loop.unpack(known), arrays[1]))[0]

    def begun(known: Packed, state: State) -> Begun:
        return begin(loop_of(known), state)

    known = eqx.filter_eval_shape(of_loop.pack, arrays[0])
    carry = eqx.filter_eval_shape(begun, known, arrays[1])[0]
    _, log, held = eqx.filter_eval_shape(lambda known, carry: decide(loop_of(known), carry), known, carry)
    of_carry, of_log, of_held = Packing(carry), Packing(log), Packing(held)

    def decided(known: Packed, kept: Packed, q: Vector, dq: Vector) -> tuple[Packed, Packed, Packed, Array]:
        before: Carry = of_carry.unpack(kept)
        seen = eqx.tree_at(lambda carry: carry.state, before, State(q=q, dq=dq))
        after, log, held = decide(loop_of(known), seen)
        return of_carry.pack(after), of_log.pack(log), of_held.pack(held), after.fault.kind

    def pushed(known: Packed, held: Packed, k: Array, i: Array, q: Vector, dq: Vector) -> Vector:
        return force(loop_of(known), of_held.unpack(held), k, i, State(q=q, dq=dq))

    nothing = of_held.pack(jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), held))
    return _Code(jax.jit(begun), jax.jit(decided), jax.jit(pushed), nothing, of_loop, of_carry, of_log)
