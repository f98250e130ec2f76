"""Coefficients of cubic and quintic splines."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def cubic_hermite(
    times: NDArray[np.float64], positions: NDArray[np.float64], velocities: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the coefficients of cubics [4 k-1 n], highest power first, from positions and velocities at knots.

    - `times`: the knots [k].
    - `positions`, `velocities`: values at the knots [k n].
    """
    h = np.diff(times)[:, None]
    p, v = positions[:-1], velocities[:-1]
    # Differences at the right end of each piece from the straight line that leaves its left end.
    dp, dv = positions[1:] - p - v * h, velocities[1:] - v
    return np.stack([(dv * h - 2 * dp) / h**3, (3 * dp - dv * h) / h**2, v, p])


def quintic_hermite(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    accelerations: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the coefficients of quintics [6 k-1 n], highest power first, from values and two derivatives at knots.

    - `times`: the knots [k].
    - `positions`, `velocities`, `accelerations`: values at the knots [k n].
    """
    h = np.diff(times)[:, None]
    p, v, a = positions[:-1], velocities[:-1], accelerations[:-1]
    # Differences at the right end of each piece from the parabola that leaves its left end, in units of position.
    dp = positions[1:] - p - v * h - a * h**2 / 2
    dv = (velocities[1:] - v - a * h) * h
    da = (accelerations[1:] - a) * h**2
    fifth = (6 * dp - 3 * dv + da / 2) / h**5
    fourth = (-15 * dp + 7 * dv - da) / h**4
    third = (10 * dp - 4 * dv + da / 2) / h**3
    return np.stack([fifth, fourth, third, a / 2, v, p])


def quintic_spline(times: NDArray[np.float64], waypoints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients of the quintic spline through waypoints, at rest at both ends, [6 k-1 n].

    The highest power of `t - times[i]` comes first.

    - `times`: times of the waypoints [k], s.
    - `waypoints`: positions at these times [k n].
    """
    from scipy.interpolate import make_interp_spline

    rest = np.zeros(waypoints.shape[1])
    ends = [(1, rest), (2, rest)]
    # Solved on [0, 1]: with the times themselves the fifth-degree basis is ill-conditioned for long motions.
    span = times[-1] - times[0]
    z = (times - times[0]) / span
    spline = make_interp_spline(z, waypoints, k=5, bc_type=(ends, ends))
    # The Taylor coefficients at the left end of each piece, where the spline and its derivatives are exact.
    return np.stack([spline(z[:-1], nu=i) / (math.factorial(i) * span**i) for i in reversed(range(6))])
