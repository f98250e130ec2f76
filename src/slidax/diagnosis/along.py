"""The nominal arm's inertia and bias along a motion."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from slidax.codegen import NoNativeCodeError, llvm, trace
from slidax.robots import AbstractRobot


def along(robot: AbstractRobot, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`M(q)` [N n n] and `C(q, q̇) q̇ + G(q)` [N n] at each of N samples, in the units of the robot.

    - `robot`: whose.
    - `q`, `dq`: positions and velocities [N n].
    """

    def at(q: Any, dq: Any) -> Any:
        return robot.mass(q), robot.bias(q, dq)

    if llvm.available():
        with suppress(NoNativeCodeError):
            joint = jax.ShapeDtypeStruct((robot.joints,), float)
            program = trace(at, joint, joint, named=False)
            program.inputs[:] = [replace(variable, varying=True) for variable in program.inputs]
            mass, bias = llvm.compile(program).batch([q, dq], runs=len(q), threads=1)
            return mass, bias
    mass, bias = jax.jit(jax.vmap(at))(jnp.asarray(q), jnp.asarray(dq))
    return np.asarray(mass), np.asarray(bias)
