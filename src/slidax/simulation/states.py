"""Inertia, forces and joint frames of a robot at many states at once."""

from __future__ import annotations

import functools
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from slidax.codegen import NoNativeCodeError, llvm, trace
from slidax.numerics import require_64_bits
from slidax.robots import AbstractRobot, Articulated

from .signature import LoopSignature

Numbers = NDArray[np.float64]


class States(NamedTuple):
    """Quantities of a robot at k states.

    - `mass`: M(q) [k n n], kg m², kg m, kg.
    - `bias`: `C(q,q̇) q̇ + G(q)` [k n], N m or N.
    - `axes`, `places`: of the joints, in the base frame [k n 3]; None for a robot without joint frames.
    - `tip`: [k 3], m.
    """

    mass: Numbers
    bias: Numbers
    tip: Numbers
    axes: Numbers | None = None
    places: Numbers | None = None

    def torque(self, ddq: Numbers) -> Numbers:
        """Torque `M(q) q̈ + C(q,q̇) q̇ + G(q)` [k n], N m or N."""
        return np.einsum("kij,kj->ki", self.mass, ddq) + self.bias


def states_of(robot: AbstractRobot, q: Numbers, dq: Numbers | None = None) -> States:
    """Return a robot's quantities at positions and velocities [k n]; at rest by default.

    Raises DefinitionError if JAX uses 32-bit numbers.
    """
    require_64_bits()
    moving = [q, np.zeros_like(q) if dq is None else dq]
    arrays, static = eqx.partition(robot, eqx.is_array)
    if llvm.available():
        with suppress(NoNativeCodeError):
            numbers = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays)]
            kernel = _state_kernel(LoopSignature.of(arrays, static, False), q.shape[1])
            return States(*kernel.batch([*numbers, *moving], runs=len(q), threads=1))
    # XLA takes a hundred times as long to compile it.
    return States(*map(np.asarray, jax.jit(jax.vmap(_state, (None, 0, 0)))(robot, *moving)))


def _state(robot: AbstractRobot, q: Array, dq: Array) -> tuple[Array, ...]:
    quantities = (robot.mass(q), robot.bias(q, dq), robot.tip(q))
    if not isinstance(robot, Articulated):
        return quantities
    rotations, places = robot.frames(q)
    return (*quantities, rotations[..., 2], places)


@functools.lru_cache(maxsize=8)
def _state_kernel(signature: LoopSignature, joints: int) -> llvm.Kernel:
    join = signature.join
    row = jax.ShapeDtypeStruct((joints,), float)
    program = trace(lambda arrays, q, dq: _state(join(arrays), q, dq), signature.arrays, row, row, named=False)
    program.inputs[-2:] = [replace(entry, varying=True) for entry in program.inputs[-2:]]
    return llvm.compile(program)


def spread(lower: Numbers, upper: Numbers, count: int) -> Numbers:
    """Return points spread evenly over a box, [count n]: a deterministic additive recurrence.

    Its steps are powers of the root of `x^(n+1) = x + 1`, the golden ratio in n dimensions.
    """
    n = len(lower)
    root = 1.5
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (n + 1))
    steps = root ** -np.arange(1.0, n + 1.0)
    share = np.modf(0.5 + np.arange(1, count + 1)[:, None] * steps)[0]
    return lower + share * (upper - lower)
