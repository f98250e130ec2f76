"""Newton's method for the equations of a task."""

from __future__ import annotations

import numpy as np

from .curve import AbstractCurve
from .series import Array
from .task import Task, linearised

TURNS = 15
"""Limit of Newton steps; near a solution three are enough."""

SMALL = 1e-9
"""A shorter step is the last one: the next would be rounding."""

EMPTY = 1e-11
"""Smaller singular values, relative to the largest, are directions in which the tool can never move."""


def converged(task: Task, curve: AbstractCurve, z: Array, s: Array) -> Array | None:
    """Return postures and forces that solve the equations [k n+m], or None if some do not converge.

    - `z`: initial values [k n+m].
    - `s`: curve parameters [k].
    """
    n = task.posture.size
    lower, upper = task.lower, task.upper
    last = False
    for _ in range(TURNS):
        equations = linearised(task, curve, z, s)
        if not (np.isfinite(equations.residual).all() and np.isfinite(equations.by_z).all()):
            return None
        if last:
            return z if np.abs(equations.residual).max() < SMALL else None
        step = -solved(equations.by_z, equations.residual)
        # Not through the wall at a joint's limit, where the equations end.
        with np.errstate(divide="ignore", invalid="ignore"):
            q, dq = z[:, :n], step[:, :n]
            room = np.where(dq > 0, (upper - q) / dq, np.where(dq < 0, (lower - q) / dq, np.inf))
        share = np.minimum(1.0, 0.9 * room.min(axis=1))
        z = z + share[:, None] * step
        # Forces do not count: they are large near a singularity.
        last = bool(np.abs(step[:, :n]).max() < SMALL and (share == 1.0).all())
    return None


def solved(matrices: Array, right: Array) -> Array:
    """Return `K⁻¹ r` for each matrix K [k m m] and vector r [k m], by the pseudo-inverse."""
    return np.einsum("kij,kj->ki", np.linalg.pinv(matrices, rcond=EMPTY), right)
