"""Hermite interpolation by cubics and quintics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def cubic_hermite(
    times: NDArray[np.float64], positions: NDArray[np.float64], velocities: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the cubics with given positions and velocities [k n] at the knots [k], [4 k-1 n], highest power first."""
    h = np.diff(times)[:, None]
    p, v = positions[:-1], velocities[:-1]
    # Differences at the right end from a straight line.
    dp, dv = positions[1:] - p - v * h, velocities[1:] - v
    return np.stack([(dv * h - 2 * dp) / h**3, (3 * dp - dv * h) / h**2, v, p])


def quintic_hermite(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    accelerations: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the quintics with given positions, velocities and accelerations [k n], [6 k-1 n], highest power first."""
    h = np.diff(times)[:, None]
    p, v, a = positions[:-1], velocities[:-1], accelerations[:-1]
    # Differences at the right end from a parabola, in units of position.
    dp = positions[1:] - p - v * h - a * h**2 / 2
    dv = (velocities[1:] - v - a * h) * h
    da = (accelerations[1:] - a) * h**2
    fifth = (6 * dp - 3 * dv + da / 2) / h**5
    fourth = (-15 * dp + 7 * dv - da) / h**4
    third = (10 * dp - 4 * dv + da / 2) / h**3
    return np.stack([fifth, fourth, third, a / 2, v, p])
