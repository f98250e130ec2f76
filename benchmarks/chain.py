"""A chain of links with any number of joints: how the cost of a law grows with the arm."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.arms import AbstractRobot


class Chain(AbstractRobot):
    """Equal point masses on massless links in a vertical plane, in absolute angles.

    `M_ij = m_ij cos(q_i - q_j)`, `(C q̇)_i = Σ_j m_ij sin(q_i - q_j) q̇_j²`, `m_ij = m l² (n - max(i, j))` from 0, and a
    motor inertia on the diagonal.
    """

    joint_units: tuple[str, ...]  # type: ignore[misc]
    joint_names: tuple[str, ...]  # type: ignore[misc]
    coupling: Any
    weight: Any

    def __init__(self, joints: int) -> None:
        later = np.maximum.outer(np.arange(joints), np.arange(joints))
        self.joint_units = ("rad",) * joints
        self.joint_names = tuple(f"joint {i + 1}" for i in range(joints))
        self.coupling = jnp.asarray(0.1 * (joints - later).astype(float))
        self.weight = jnp.asarray(0.1 * 9.8 * (joints - np.arange(joints)).astype(float))

    def mass(self, q: Any) -> Any:
        """`M(q)`."""
        c, s = jnp.cos(q), jnp.sin(q)
        return self.coupling * (c[:, None] * c + s[:, None] * s) + jnp.eye(len(self.joint_units))

    def bias(self, q: Any, dq: Any) -> Any:
        """`C q̇ + G`."""
        c, s = jnp.cos(q), jnp.sin(q)
        difference = s[:, None] * c - c[:, None] * s
        return jnp.sum(self.coupling * difference * (dq * dq), axis=1) + self.weight * c

    def friction(self, dq: Any) -> Any:
        """None."""
        return jnp.zeros_like(dq)

    def potential(self, q: Any) -> Any:
        """Potential energy."""
        return jnp.sum(self.weight * jnp.sin(q))

    def tip(self, q: Any) -> Any:
        """The end of the chain."""
        return jnp.stack([jnp.sum(jnp.cos(q)), jnp.sum(jnp.sin(q)), jnp.zeros(())])
