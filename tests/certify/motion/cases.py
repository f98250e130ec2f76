"""Arms, loops and motions of the tests of bounds along a motion."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import slidax.arms as arms
from slidax.motions.tabulated import Tabulated


def panda(payload: float = 2.0) -> Any:
    """The Panda with a payload 0.1 m beyond its flange and rotors of 0.1 kg m²."""
    load = arms.Payload(mass=payload, center=[0, 0, 0.1], inertia=0.0025 * payload)
    return eqx.tree_at(
        lambda arm: (arm.armature, arm.viscous, arm.payload), arms.panda(), (jnp.full(7, 0.1), jnp.full(7, 0.2), load)
    )


def ur5e(payload: float = 3.0) -> Any:
    load = arms.Payload(mass=payload, center=[0, 0, 0.1], inertia=0.0025 * payload)
    return eqx.tree_at(
        lambda arm: (arm.armature, arm.viscous, arm.payload), arms.ur5e(), (jnp.full(6, 0.1), jnp.full(6, 0.2), load)
    )


def box(arm: Any) -> tuple[np.ndarray, np.ndarray]:
    """Joint range less 0.1 rad, within ± π."""
    lower, upper = np.asarray(arm.limits.lower), np.asarray(arm.limits.upper)
    return np.maximum(lower, -np.pi) + 0.1, np.minimum(upper, np.pi) - 0.1


def quintic(arm: Any, rng: np.random.Generator, share: float, acceleration: float = 10.0) -> Any:
    """Point to point, at rest at both ends, at a share of the largest speeds and accelerations."""
    lower, upper = box(arm)
    ends = rng.uniform(lower, upper, size=(2, arm.joints))
    gone = np.abs(ends[1] - ends[0])
    speed = share * np.asarray(arm.limits.velocity)
    time = max(np.max(1.875 * gone / speed), np.max(np.sqrt(5.7735 * gone / (share * acceleration))))
    return Tabulated.through([0.0, time], ends, np.zeros_like(ends), np.zeros_like(ends))


def knotted(arm: Any, rng: np.random.Generator, share: float, acceleration: float = 10.0) -> Any:
    """Like a time-optimal path along three straight stretches with blends, with knots each 0.1 s."""
    lower, upper = box(arm)
    points = rng.uniform(lower, upper, size=(3, arm.joints))
    # A blended polygon by its length, with a trapezoid in time.
    s = np.linspace(0.0, 1.0, 2001)
    polygon = np.stack([np.interp(s, [0.0, 0.5, 1.0], points[:, j]) for j in range(arm.joints)], axis=1)
    width = 401
    kernel = np.hanning(width + 2)[1:-1]
    kernel /= kernel.sum()
    padded = np.concatenate([np.repeat(polygon[:1], width // 2, 0), polygon, np.repeat(polygon[-1:], width // 2, 0)])
    path = np.stack([np.convolve(padded[:, j], kernel, "valid") for j in range(arm.joints)], axis=1)
    first, second = np.gradient(path, s, axis=0), np.gradient(np.gradient(path, s, axis=0), s, axis=0)
    speed, limit = share * np.asarray(arm.limits.velocity), share * acceleration
    rate = np.min(speed / np.maximum(np.abs(first), 1e-9), axis=1)
    rate = np.minimum(rate, np.min(np.sqrt(0.5 * limit / np.maximum(np.abs(second), 1e-9)), axis=1))
    rate[[0, -1]] = 0.0
    push = np.min(0.5 * limit / np.maximum(np.abs(first), 1e-9), axis=1)
    step = s[1] - s[0]
    for _ in range(2):
        for i in range(1, len(s)):
            rate[i] = min(rate[i], np.sqrt(rate[i - 1] ** 2 + 2 * push[i - 1] * step))
        rate = rate[::-1]
        push = push[::-1]
    times = np.concatenate([[0.0], np.cumsum(2 * step / np.maximum(rate[1:] + rate[:-1], 1e-6))])
    knots = np.linspace(0.0, times[-1], max(3, int(np.ceil(times[-1] / 0.1)) + 1))
    at = np.interp(knots, times, s)
    through = np.stack([np.interp(at, s, path[:, j]) for j in range(arm.joints)], axis=1)
    return Tabulated.through(knots, through, acceleration=200.0)


def desired(motion: Any, period: float, slots: int, sub: int, delay: int) -> np.ndarray:
    """Positions and velocities at substeps [(slots + delay + 1) sub + 1, 2, n]."""
    from slidax.certify.motion.path_cells import Pieces

    t = np.arange((slots + delay + 1) * sub + 1) * (period / sub)
    values = Pieces.of(motion).at(t)
    return np.stack(values[:2], axis=1)
