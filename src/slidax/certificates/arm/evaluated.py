"""Inertia, bias, friction and outer forces of many arms at many states, by native code where there is some."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax._types import State
from slidax.codegen import NoNativeCodeError, llvm, trace
from slidax.robots import AbstractRobot, Articulated, Load
from slidax.simulation import Plant

Floats: TypeAlias = NDArray[np.floating[Any]]
Flags: TypeAlias = NDArray[np.bool_]

BLOCK = 65536
"""States at a time: so many inertia matrices of seven joints are 25 MB."""

_kernels: dict[Any, Callable[..., tuple[Floats, Floats]]] = {}


def mass_and_bias(robot: AbstractRobot, load: Load | None, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
    """`M(q)` [N n n] and `C(q,q̇) q̇ + G(q)` [N n] with what the arm carries at each time.

    Arms of one structure share their machine code: their numbers are inputs of it.

    - `robot`: whose.
    - `load`: what it carries for some time; None for nothing.
    - `t`: times [N], s.
    - `q`, `dq`: positions and velocities [N n].
    """
    arrays, rest = eqx.partition((robot, load), eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    leaves = [np.asarray(leaf, float) for leaf in leaves]
    key = tree, tuple(leaf.shape for leaf in leaves), str(rest)
    if key not in _kernels:
        _kernels[key] = _kernel(leaves, tree, rest, robot.joints)
    found = [
        _kernels[key](t[k : k + BLOCK], q[k : k + BLOCK], dq[k : k + BLOCK], leaves) for k in range(0, len(t), BLOCK)
    ]
    return np.concatenate([mass for mass, _ in found]), np.concatenate([bias for _, bias in found])


def _kernel(leaves: list[Floats], tree: Any, rest: Any, joints: int) -> Callable[..., tuple[Floats, Floats]]:
    def at(t: Any, q: Any, dq: Any, *given: Any) -> Any:
        robot, load = eqx.combine(jax.tree.unflatten(tree, list(given)), rest)
        carrying = robot if load is None else load.on(robot, t)
        return carrying.mass(q), carrying.bias(q, dq)

    if llvm.available():
        with suppress(NoNativeCodeError):
            number, joint = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((joints,), float)
            shapes = [jax.ShapeDtypeStruct(leaf.shape, float) for leaf in leaves]
            program = trace(at, number, joint, joint, *shapes, named=False)
            program.inputs[:] = [replace(one, varying=k < 3) for k, one in enumerate(program.inputs)]
            kernel = llvm.compile(program)

            def native(t: Floats, q: Floats, dq: Floats, leaves: list[Floats]) -> tuple[Floats, Floats]:
                mass, bias = kernel.batch([t, q, dq, *leaves], runs=len(t))
                return mass, bias

            return native
    compiled = jax.jit(jax.vmap(at, in_axes=(0, 0, 0, *[None] * len(leaves))))

    def plain(t: Floats, q: Floats, dq: Floats, leaves: list[Floats]) -> tuple[Floats, Floats]:
        mass, bias = compiled(t, q, dq, *leaves)
        return np.asarray(mass), np.asarray(bias)

    return plain


def unloaded(robot: AbstractRobot, like: Plant) -> Load | None:
    """A load without mass for an arm of the structure of another, so that both share their machine code; else None.

    - `robot`: which carries nothing.
    - `like`: the other, with its load.
    """
    alike = bool(jax.tree.structure(robot) == jax.tree.structure(like.robot))  # type: ignore[operator]
    if like.load is None or not alike:
        return None
    return eqx.tree_at(lambda load: load.payload, like.load, like.load.payload.times(jnp.zeros(())))


def friction(robot: AbstractRobot, dq: Floats) -> Floats:
    """`F(q̇)` [N n], N m or N.

    - `robot`: whose.
    - `dq`: velocities [N n].
    """
    if isinstance(robot, Articulated):
        coulomb, viscous, smoothing = (np.asarray(x) for x in (robot.coulomb, robot.viscous, robot.smoothing))
        return coulomb * np.tanh(dq / smoothing) + viscous * dq
    return np.asarray(_friction(robot, jnp.asarray(dq)))


def pushed(plant: Plant, t: Floats, q: Floats, dq: Floats) -> Floats:
    """`τ_d` [N n], N m or N.

    - `plant`: with what pushes it.
    - `t`: times [N], s.
    - `q`, `dq`: positions and velocities [N n].
    """
    return np.asarray(_pushed(plant.disturbance, jnp.asarray(t), jnp.asarray(q), jnp.asarray(dq)))


@eqx.filter_jit
def _friction(robot: AbstractRobot, dq: Any) -> Any:
    return jax.vmap(robot.friction)(dq)


@eqx.filter_jit
def _pushed(disturbance: Any, t: Any, q: Any, dq: Any) -> Any:
    return jax.vmap(lambda t, q, dq: disturbance(t, State(q=q, dq=dq)))(t, q, dq)
