"""Start and motion within the limits of the robot's joints, before any time passes."""

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
"""A limit that is reached exactly is passed by rounding, and may be by this part."""

CHUNK = 1_000_000
"""Samples that are looked at together, for the memory that they take."""

REMEDY = 'keep to it, or say `limits="ignore"` (`simulation.limits: ignore`)'


def require_within_limits(
    robot: AbstractRobot, trajectory: AbstractTrajectory, state0: State, steps: int, stepping: Stepping
) -> None:
    """Raises DefinitionError if the start or the motion, at the samples of the run, is beyond a limit of the joints.

    A velocity is the mean one between two samples: if that is beyond the limit, so is the motion's own at some time.

    - `robot`: whose limits; one without limits allows all.
    - `trajectory`: the motion.
    - `state0`: the start.
    - `steps`: number of periods.
    - `stepping`: the period, and whether limits are checked.
    """
    if (
        stepping.limits == "ignore"
        or not isinstance(robot, Articulated | Coupled)
        or is_traced((robot.limits, trajectory))
    ):
        return
    if not is_traced(state0):
        found = _beyond(robot, np.asarray(state0.q)[None], np.asarray(state0.dq)[None])
        if found is not None:
            raise DefinitionError(f"`state0` is beyond the robot's limits: {found[1]}; {REMEDY}")
    # Once it stands still, it has shown what there is. It is known, also where a batch of other things is traced.
    with jax.ensure_compile_time_eval():
        until = float(trajectory.until)
    last = int(min(steps, np.ceil(until / stepping.period) + 1))
    for first in range(0, last, CHUNK):
        times = np.arange(first, min(first + CHUNK, last) + 1) * stepping.period
        q = _positions(trajectory, times)
        found = _beyond(robot, q, np.diff(q, axis=0) / stepping.period)
        if found is not None:
            raise DefinitionError(
                f"the motion is beyond the robot's limits: at t = {times[found[0]]:.6g} s {found[1]}; {REMEDY}"
            )


def _beyond(robot: Articulated | Coupled, q: np.ndarray, dq: np.ndarray) -> tuple[int, str] | None:
    """The first sample beyond a limit, and what which joint does there: positions first, then velocities."""
    limits = robot.limits
    lower, upper, fastest = (np.asarray(bound) for bound in (limits.lower, limits.upper, limits.velocity))
    for values, low, high, verb, per in ((q, lower, upper, "is at", ""), (dq, -fastest, fastest, "moves at", "/s")):
        room = ROUNDING * np.maximum(1.0, np.abs(values).max(axis=0))
        over = (values < low - room) | (values > high + room)
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
    """The motion at these times, [times n]: XLA takes ten times as long to compile what is asked for once."""
    arrays, static = eqx.partition(trajectory, eqx.is_array)
    signature = LoopSignature.of(arrays, static, False)
    if llvm.available():
        with suppress(NoNativeCodeError):
            numbers = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays)]
            return _compiled(signature).batch([*numbers, times], runs=len(times), threads=1)[0]
    return np.asarray(jax.jit(jax.vmap(trajectory.position))(times))


@functools.lru_cache(maxsize=16)
def _compiled(signature: LoopSignature) -> llvm.Kernel:
    whole = signature.whole
    time = jax.ShapeDtypeStruct((), float)
    program = trace(lambda given, t: whole(given).position(t), signature.arrays, time, named=False)
    program.inputs[-1] = replace(program.inputs[-1], varying=True)
    return llvm.compile(program)
