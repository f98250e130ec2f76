"""Inertia, bias, friction and external torque of many arms at many states, by native code if possible."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from slidax.codegen import NoNativeCodeError, llvm, trace
from slidax.robots import AbstractRobot, Articulated, Load
from slidax.simulation import Plant

from ..each import Floats

BLOCK = 65536
"""States per block: that many inertia matrices of seven joints take 25 MB."""

_kernels: dict[Any, Callable[..., tuple[Floats, Floats]]] = {}


def mass_and_bias(robot: AbstractRobot, load: Load | None, t: Floats, q: Floats, dq: Floats) -> tuple[Floats, Floats]:
    """Return `M(q)` [N n n] and `C(q,q̇) q̇ + G(q)` [N n] with the payload at each time.

    Arms of one structure share their machine code: their values are inputs of it.

    - `load`: the timed payload; None for none.
    - `t`: [N], s.
    """
    arrays, rest = eqx.partition((robot, load), eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    leaves = [np.asarray(leaf, float) for leaf in leaves]
    key = tree, tuple(leaf.shape for leaf in leaves), str(rest)
    if key not in _kernels:
        _kernels[key] = _kernel(leaves, tree, rest, robot.joints)
    blocks = [
        _kernels[key](t[k : k + BLOCK], q[k : k + BLOCK], dq[k : k + BLOCK], leaves) for k in range(0, len(t), BLOCK)
    ]
    return np.concatenate([mass for mass, _ in blocks]), np.concatenate([bias for _, bias in blocks])


def _kernel(leaves: list[Floats], tree: Any, rest: Any, joints: int) -> Callable[..., tuple[Floats, Floats]]:
    def at(t: Any, q: Any, dq: Any, *leaves: Any) -> Any:
        robot, load = eqx.combine(jax.tree.unflatten(tree, list(leaves)), rest)
        carrying = robot if load is None else load.on(robot, t)
        return carrying.mass(q), carrying.bias(q, dq)

    if llvm.available():
        with suppress(NoNativeCodeError):
            number, joint = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((joints,), float)
            shapes = [jax.ShapeDtypeStruct(leaf.shape, float) for leaf in leaves]
            program = trace(at, number, joint, joint, *shapes, named=False)
            program.inputs[:] = [replace(source, varying=k < 3) for k, source in enumerate(program.inputs)]
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
    """Return a payload without mass for a robot of another plant's structure, so that both share their machine code.

    None if the structures differ, or the other plant has no payload.
    """
    alike = bool(jax.tree.structure(robot) == jax.tree.structure(like.robot))  # type: ignore[operator]
    if like.load is None or not alike:
        return None
    return eqx.tree_at(lambda load: load.payload, like.load, like.load.payload.times(jnp.zeros(())))


def friction(robot: AbstractRobot, dq: Floats) -> Floats:
    """Return `F(q̇)` [N n], N m or N."""
    if isinstance(robot, Articulated):
        coulomb, viscous, smoothing = (np.asarray(x) for x in (robot.coulomb, robot.viscous, robot.smoothing))
        return coulomb * np.tanh(dq / smoothing) + viscous * dq
    return np.asarray(_friction(robot, jnp.asarray(dq)))


def pushed(plant: Plant, t: Floats, q: Floats, dq: Floats) -> Floats:
    """Return the external torque `τ_d` [N n], N m or N."""
    return np.asarray(_pushed(plant.disturbance, jnp.asarray(t), jnp.asarray(q), jnp.asarray(dq)))


@eqx.filter_jit
def _friction(robot: AbstractRobot, dq: Any) -> Any:
    return jax.vmap(robot.friction)(dq)


@eqx.filter_jit
def _pushed(disturbance: Any, t: Any, q: Any, dq: Any) -> Any:
    return jax.vmap(lambda t, q, dq: disturbance(t, State(q=q, dq=dq)))(t, q, dq)
