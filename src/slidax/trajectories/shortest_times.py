"""The shortest times for a quintic spline through waypoints, under limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .extremes import derived, extremes
from .quintic_spline import quintic_spline

SAMPLES = 16
"""Parts of a piece between which the search looks for its peaks; what it finds is then scaled by the exact extremes."""

SHORTEST = 0.02
"""The search shortens no piece below this part of what it was at first."""

AT_REST = {1: 15 / 8, 2: 10 / math.sqrt(3), 3: 60.0}
"""The largest velocity, acceleration and jerk of the quintic from 0 to 1 in unit time, at rest at both ends."""


def shortest_times(waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """When to pass each waypoint, [k], from 0 on, so that all limits hold and one is reached.

    - `waypoints`: positions [k n], no two in a row the same.
    - `limits`: of each joint [n], by the order of the derivative: 1, 2, 3; infinite for none.

    Stretching all times by c divides the derivative of order i by c^i, so that for given proportions the shortest
    times are known. The proportions are found by sequential quadratic programming from those that the pieces would
    have on their own; it is a local search, and of what it found and where it began the shorter is taken.
    """
    steps = np.abs(np.diff(waypoints, axis=0))
    least = np.stack([(AT_REST[order] * steps / bound) ** (1 / order) for order, bound in limits.items()])
    begin = _stretched(np.asarray(least.max(axis=(0, 2)), dtype=float), waypoints, limits)
    if len(begin) == 1:
        return _times(begin)
    found = _stretched(_proportions(begin, waypoints, limits), waypoints, limits)
    best = min(begin, found, key=np.sum)
    return _times(best)


def _times(durations: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(durations)])


def _stretched(
    durations: NDArray[np.float64], waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """The durations, all longer or shorter by the same factor, so that the tightest limit is reached exactly."""
    times = _times(durations)
    coefficients = quintic_spline(times, waypoints)
    ratios = [np.max(extremes(times, coefficients, i).size / bound) ** (1 / i) for i, bound in limits.items()]
    return durations * max(ratios)


def _peak(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """The top of the parabola through the largest sample and its neighbours, [pieces n].

    - `samples`: [samples pieces n].
    """
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
    """Durations with the least sum for which no limit is passed at the sampled points, as well as the search can."""
    from scipy.optimize import minimize

    z = np.linspace(0.0, 1.0, SAMPLES + 1)

    def left(durations: NDArray[np.float64]) -> NDArray[np.float64]:
        """How much of each limit is left, per piece and joint: 1 at rest, 0 where it is reached."""
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
