"""A robot's inertia, forces and places in many states at once."""

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
    """What a robot is like in each of k states.

    - `mass`: M(q) [k n n], kg m², kg m, kg.
    - `bias`: `C(q,q̇) q̇ + G(q)` [k n], N m or N.
    - `axes`, `places`: of an arm's joints, in the base frame [k n 3]; None for a robot that has no joint frames.
    - `tip`: [k 3].
    """

    mass: Numbers
    bias: Numbers
    tip: Numbers
    axes: Numbers | None = None
    places: Numbers | None = None

    def torque(self, ddq: Numbers) -> Numbers:
        """`M(q) q̈ + C(q,q̇) q̇ + G(q)` [k n], N m or N.

        - `ddq`: accelerations [k n].
        """
        return np.einsum("kij,kj->ki", self.mass, ddq) + self.bias


def states_of(robot: AbstractRobot, q: Numbers, dq: Numbers | None = None) -> States:
    """What the robot is like in many states.

    - `robot`: the robot.
    - `q`, `dq`: positions and velocities [k n]; at rest if not given.

    Raises DefinitionError where JAX has 32-bit numbers.
    """
    require_64_bits()
    moving = [q, np.zeros_like(q) if dq is None else dq]
    arrays, static = eqx.partition(robot, eqx.is_array)
    if llvm.available():
        with suppress(NoNativeCodeError):
            numbers = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays)]
            kernel = _compiled(LoopSignature.of(arrays, static, False), q.shape[1])
            return States(*kernel.batch([*numbers, *moving], runs=len(q), threads=1))
    # XLA takes a hundred times as long to compile it.
    found = jax.jit(jax.vmap(_state, (None, 0, 0)))(robot, *moving)
    return States(*(np.asarray(one) for one in found))


def _state(robot: AbstractRobot, q: Array, dq: Array) -> tuple[Array, ...]:
    found = (robot.mass(q), robot.bias(q, dq), robot.tip(q))
    if not isinstance(robot, Articulated):
        return found
    rotations, places = robot.frames(q)
    return (*found, rotations[..., 2], places)


@functools.lru_cache(maxsize=8)
def _compiled(signature: LoopSignature, joints: int) -> llvm.Kernel:
    whole = signature.whole
    each = jax.ShapeDtypeStruct((joints,), float)
    program = trace(lambda given, q, dq: _state(whole(given), q, dq), signature.arrays, each, each, named=False)
    program.inputs[-2:] = [replace(one, varying=True) for one in program.inputs[-2:]]
    return llvm.compile(program)


def spread(lower: Numbers, upper: Numbers, count: int) -> Numbers:
    """Points spread evenly over a box, the same ones each time [count n]: an additive recurrence.

    Its steps are powers of the root of `x^(n+1) = x + 1`, the golden ratio's relative in n dimensions.

    - `lower`, `upper`: ends of the box [n].
    - `count`: how many.
    """
    n = len(lower)
    root = 1.5
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (n + 1))
    steps = root ** -np.arange(1.0, n + 1.0)
    share = np.modf(0.5 + np.arange(1, count + 1)[:, None] * steps)[0]
    return lower + share * (upper - lower)
