"""Evaluation of robots and motions at many states at once: inertia, forces, joint frames, joint limits."""

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

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.codegen import llvm
from slidax.codegen.ir import NoNativeCodeError
from slidax.codegen.trace.tracing import trace
from slidax.core.errors import DefinitionError, is_traced
from slidax.core.joint_names import joint_label
from slidax.core.tracing import require_64_bits
from slidax.core.types import State
from slidax.motions.trajectory import AbstractMotion

from .native_loop import LoopSignature
from .stepping import Stepping

Numbers = NDArray[np.float64]


class States(NamedTuple):
    """Mass matrix, forces, tip and joint frames at k states of a robot with n joints.

    - `mass`: M(q) [k n n], kg m², kg m, kg.
    - `bias`: `C(q,q̇) q̇ + G(q)` [k n], N m or N.
    - `tip`: position of the tip [k 3], m.
    - `axes`, `positions`: joint axes and positions in the base frame [k n 3]; None for a robot without joint frames.
    """

    mass: Numbers
    bias: Numbers
    tip: Numbers
    axes: Numbers | None = None
    positions: Numbers | None = None

    def torque(self, ddq: Numbers) -> Numbers:
        """Return the torque `M(q) q̈ + C(q,q̇) q̇ + G(q)` [k n], N m or N.

        - `ddq`: accelerations [k n], rad/s² or m/s².
        """
        return np.einsum("kij,kj->ki", self.mass, ddq) + self.bias


def states_of(robot: AbstractRobot, q: Numbers, dq: Numbers | None = None) -> States:
    """Return a robot's mass matrix, forces, tip and joint frames at k states.

    - `q`: positions [k n], rad or m.
    - `dq`: velocities [k n], rad/s or m/s; 0 by default.

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
    # XLA is only the alternative, since its compilation takes a hundred times as long.
    return States(*map(np.asarray, jax.jit(jax.vmap(_state, (None, 0, 0)))(robot, *moving)))


def _state(robot: AbstractRobot, q: Array, dq: Array) -> tuple[Array, ...]:
    quantities = (robot.mass(q), robot.bias(q, dq), robot.tip(q))
    if not isinstance(robot, Articulated):
        return quantities
    rotations, positions = robot.frames(q)
    return (*quantities, rotations[..., 2], positions)


@functools.lru_cache(maxsize=8)
def _state_kernel(signature: LoopSignature, joints: int) -> llvm.Kernel:
    join = signature.join
    row = jax.ShapeDtypeStruct((joints,), float)
    program = trace(lambda arrays, q, dq: _state(join(arrays), q, dq), signature.arrays, row, row, named=False)
    program.inputs[-2:] = [replace(entry, varying=True) for entry in program.inputs[-2:]]
    return llvm.compile(program)


def spread_in_box(lower: Numbers, upper: Numbers, count: int) -> Numbers:
    """Return points spread evenly over a box, [count n], by an additive recurrence (quasi-random, deterministic).

    The recurrence's steps are negative powers of the root of `x^(n+1) = x + 1`, the golden ratio in n dimensions.

    - `lower`, `upper`: ends of the box [n].
    - `count`: number of points.
    """
    n = len(lower)
    root = 1.5
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (n + 1))
    steps = root ** -np.arange(1.0, n + 1.0)
    share = np.modf(0.5 + np.arange(1, count + 1)[:, None] * steps)[0]
    return lower + share * (upper - lower)


ROUNDING = 1e-9
"""Allowed relative excess over a limit, for rounding."""

CHUNK = 1_000_000
"""Number of samples that are checked together, to limit memory."""

REMEDY = 'stay within the limit, or set `limits="ignore"` (`simulation.limits: ignore`)'


def require_within_limits(
    robot: AbstractRobot, trajectory: AbstractMotion, state0: State, steps: int, stepping: Stepping
) -> None:
    """Raise a DefinitionError if the start, or the motion at a sample of the run, exceeds a joint limit.

    Velocities are means between two samples: if a mean exceeds the limit, so does the motion at some time. The check
    needs known values and a robot with joint limits; otherwise, and with `stepping.limits` "ignore", it is skipped.

    - `steps`: number of periods of the run.
    """
    if (
        stepping.limits == "ignore"
        or not isinstance(robot, Articulated | Coupled)
        or is_traced((robot.limits, trajectory))
    ):
        return
    if not is_traced(state0):
        excess = _first_excess(robot, np.asarray(state0.q)[None], np.asarray(state0.dq)[None])
        if excess is not None:
            raise DefinitionError(f"`state0` is beyond the robot's limits: {excess[1]}; {REMEDY}")
    # After `until` the reference is at rest. The motion's values are known here, even inside a traced batch.
    with jax.ensure_compile_time_eval():
        until = float(trajectory.until)
    last = int(min(steps, np.ceil(until / stepping.period) + 1))
    for first in range(0, last, CHUNK):
        times = np.arange(first, min(first + CHUNK, last) + 1) * stepping.period
        q = _positions(trajectory, times)
        excess = _first_excess(robot, q, np.diff(q, axis=0) / stepping.period)
        if excess is not None:
            raise DefinitionError(
                f"the motion is beyond the robot's limits: at t = {times[excess[0]]:.6g} s {excess[1]}; {REMEDY}"
            )


def _first_excess(robot: Articulated | Coupled, q: np.ndarray, dq: np.ndarray) -> tuple[int, str] | None:
    """Return the first sample beyond a limit, and its description: positions first, then velocities."""
    limits = robot.limits
    lower, upper, fastest = (np.asarray(bound) for bound in (limits.lower, limits.upper, limits.velocity))
    for values, low, high, verb, per in ((q, lower, upper, "is at", ""), (dq, -fastest, fastest, "moves at", "/s")):
        margin = ROUNDING * np.maximum(1.0, np.abs(values).max(axis=0))
        over = (values < low - margin) | (values > high + margin)
        if over.any():
            k = int(np.argmax(over.any(axis=1)))
            joint = int(np.argmax(over[k]))
            value, unit = values[k, joint], robot.joint_units[joint] + per
            side, limit = ("below", low[joint]) if value < low[joint] else ("above", high[joint])
            name = joint_label(robot.joint_names[joint])
            return k, f"{name} {verb} {value:.6g} {unit}, {side} its limit of {limit:.6g} {unit}"
    return None


def _positions(trajectory: AbstractMotion, times: np.ndarray) -> np.ndarray:
    """Return a motion's positions at times [times n], by machine code if possible: XLA compiles ten times as long."""
    arrays, static = eqx.partition(trajectory, eqx.is_array)
    signature = LoopSignature.of(arrays, static, False)
    if llvm.available():
        with suppress(NoNativeCodeError):
            numbers = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays)]
            return _motion_kernel(signature).batch([*numbers, times], runs=len(times), threads=1)[0]
    return np.asarray(jax.jit(jax.vmap(trajectory.position))(times))


@functools.lru_cache(maxsize=16)
def _motion_kernel(signature: LoopSignature) -> llvm.Kernel:
    join = signature.join
    time = jax.ShapeDtypeStruct((), float)
    program = trace(lambda arrays, t: join(arrays).position(t), signature.arrays, time, named=False)
    program.inputs[-1] = replace(program.inputs[-1], varying=True)
    return llvm.compile(program)
