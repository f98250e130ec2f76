"""The shortest times for a quintic spline through waypoints, under limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .extremes import derived, extremes
from .quintic_spline import quintic_spline

SAMPLES = 16
"""Samples of a piece in the search for its peaks; the exact extremes then scale the result."""

SHORTEST = 0.02
"""Least duration of a piece in the search, as a part of its first duration."""

AT_REST = {1: 15 / 8, 2: 10 / math.sqrt(3), 3: 60.0}
"""The largest velocity, acceleration and jerk of the quintic from 0 to 1 in unit time, at rest at both ends."""


def shortest_times(waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the times of the waypoints, [k], from 0 on, so that all limits hold and one is reached.

    Stretching all times by c divides the derivative of order i by c^i, so for given proportions the shortest times are
    known. Sequential quadratic programming finds the proportions, starting at those of the separate pieces. The search
    is local; the shorter of its start and its result is taken.

    - `waypoints`: positions [k n], no two in a row the same.
    - `limits`: limits of the joints [n] by order of the derivative, 1, 2, 3; infinite for none.
    """
    steps = np.abs(np.diff(waypoints, axis=0))
    least = np.stack([(AT_REST[order] * steps / bound) ** (1 / order) for order, bound in limits.items()])
    begin = _stretched(np.asarray(least.max(axis=(0, 2)), dtype=float), waypoints, limits)
    if len(begin) == 1:
        return _times(begin)
    searched = _stretched(_proportions(begin, waypoints, limits), waypoints, limits)
    best = min(begin, searched, key=np.sum)
    return _times(best)


def _times(durations: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(durations)])


def _stretched(
    durations: NDArray[np.float64], waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Durations times one factor, so that the tightest limit is reached exactly."""
    times = _times(durations)
    coefficients = quintic_spline(times, waypoints)
    ratios = [np.max(extremes(times, coefficients, i).size / bound) ** (1 / i) for i, bound in limits.items()]
    return durations * max(ratios)


def _peak(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Top of the parabola through the largest sample and its neighbours, [pieces n]."""
    top = np.argmax(samples, axis=0)[None]
    before, at, after = (
        np.take_along_axis(samples, np.clip(top + step, 0, len(samples) - 1), axis=0)[0] for step in (-1, 0, 1)
    )
    bend = 2 * at - before - after
    inside = (top[0] > 0) & (top[0] < len(samples) - 1) & (bend > 0)
    rise: NDArray[np.float64] = np.where(inside, (after - before) ** 2, 0.0) / np.where(inside, 8 * bend, 1.0)
    return at + rise


def _proportions(
    begin: NDArray[np.float64], waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Durations with the least sum for which the sampled points keep the limits."""
    from scipy.optimize import minimize

    z = np.linspace(0.0, 1.0, SAMPLES + 1)

    def left(durations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Remaining part of each limit, per piece and joint: 1 at rest, 0 at the limit."""
        coefficients = quintic_spline(_times(durations), waypoints)
        parts = []
        for order, bound in limits.items():
            powers = derived(coefficients, order)
            degrees = np.arange(len(powers) - 1, -1, -1)
            basis = (z[:, None] * durations) ** degrees[:, None, None]
            peak = _peak(np.abs(np.einsum("dsp,dpn->spn", basis, powers)))
            # The root makes all orders alike: each goes with one over the durations.
            parts.append((1.0 - (peak / bound) ** (1 / order))[:, np.isfinite(bound)].ravel())
        return np.concatenate(parts)

    done = minimize(
        lambda share: float(np.sum(share * begin)) / float(np.sum(begin)),
        np.ones_like(begin),
        jac=lambda share: begin / float(np.sum(begin)),
        method="SLSQP",
        bounds=[(SHORTEST, None)] * len(begin),
        constraints={"type": "ineq", "fun": lambda share: left(share * begin)},
        options={"maxiter": 200, "ftol": 1e-7},
    )
    return begin * (np.maximum(done.x, SHORTEST) if np.all(np.isfinite(done.x)) else 1.0)
