"""Check that the start and the motion are within the joint limits."""

from __future__ import annotations

import functools
from contextlib import suppress
from dataclasses import replace

import equinox as eqx
import jax
import numpy as np

from slidax._errors import DefinitionError, is_traced
from slidax._types import State
from slidax.codegen import NoNativeCodeError, llvm, trace
from slidax.robots import AbstractRobot, Articulated, Coupled
from slidax.trajectories import AbstractTrajectory

from .signature import LoopSignature
from .stepping import Stepping

ROUNDING = 1e-9
"""Relative excess over a limit that is allowed for rounding."""

CHUNK = 1_000_000
"""Samples that are checked together, to limit memory."""

REMEDY = 'stay within the limit, or set `limits="ignore"` (`simulation.limits: ignore`)'


def require_within_limits(
    robot: AbstractRobot, trajectory: AbstractTrajectory, state0: State, steps: int, stepping: Stepping
) -> None:
    """Raise a DefinitionError if the start, or the motion at a sample of the run, exceeds a joint limit.

    Velocities are means between two samples: if a mean exceeds the limit, so does the motion at some time.

    - `steps`: number of periods.
    """
    if (
        stepping.limits == "ignore"
        or not isinstance(robot, Articulated | Coupled)
        or is_traced((robot.limits, trajectory))
    ):
        return
    if not is_traced(state0):
        excess = _beyond(robot, np.asarray(state0.q)[None], np.asarray(state0.dq)[None])
        if excess is not None:
            raise DefinitionError(f"`state0` is beyond the robot's limits: {excess[1]}; {REMEDY}")
    # Later samples stand still. The motion is known, also inside a traced batch.
    with jax.ensure_compile_time_eval():
        until = float(trajectory.until)
    last = int(min(steps, np.ceil(until / stepping.period) + 1))
    for first in range(0, last, CHUNK):
        times = np.arange(first, min(first + CHUNK, last) + 1) * stepping.period
        q = _positions(trajectory, times)
        excess = _beyond(robot, q, np.diff(q, axis=0) / stepping.period)
        if excess is not None:
            raise DefinitionError(
                f"the motion is beyond the robot's limits: at t = {times[excess[0]]:.6g} s {excess[1]}; {REMEDY}"
            )


def _beyond(robot: Articulated | Coupled, q: np.ndarray, dq: np.ndarray) -> tuple[int, str] | None:
    """The first sample beyond a limit, and a description: positions first, then velocities."""
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
            return k, (
                f"joint `{robot.joint_names[joint]}` {verb} {value:.6g} {unit}, {side} its limit of {limit:.6g} {unit}"
            )
    return None


def _positions(trajectory: AbstractTrajectory, times: np.ndarray) -> np.ndarray:
    """The motion at these times, [times n], by machine code if possible: XLA compiles ten times longer."""
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
