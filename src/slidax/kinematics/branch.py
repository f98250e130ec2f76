"""Postures along a curve, continued from its start."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .curve import AbstractCurve
from .newton import converged, solved
from .series import Array
from .task import Task, curvature, linearised

FAR = 0.05
"""Largest deviation of the next posture from its prediction, rad or m; beyond it may be another branch."""

SHORTEST = 1e-5
"""Shortest step along a curve, as a part of the curve; the branch ends if a step must be shorter."""


class Stuck(Exception):
    """The search finds no posture beyond a point of the curve.

    - `s`: the last point [0, 1].
    - `z`: posture and forces there [n + m].
    """

    def __init__(self, s: float, z: Array) -> None:
        super().__init__()
        self.s, self.z = s, z


class Slopes(NamedTuple):
    """Postures and forces at points of a branch [k n+m], with two derivatives along the curve."""

    z: Array
    first: Array
    second: Array


def continued(task: Task, curve: AbstractCurve, z: Array, s: Array) -> Array:
    """Return postures and forces at points of a curve, one after the other [k n+m].

    - `z`: solution of the equations at the curve's start [n + m].
    - `s`: the points, from 0 on, not decreasing [k].

    Raises Stuck where the search finds no next posture.
    """
    n = task.posture.size
    postures, here, now = [], 0.0, z
    slope = slopes(task, curve, now[None], np.array([here]))
    for point in s:
        step = float(point) - here
        while here < point:
            step = min(step, float(point) - here)
            # The last step ends at the point itself.
            there = float(point) if float(point) - here - step < 1e-12 else here + step
            x = there - here
            predicted = now + x * slope.first[0] + 0.5 * x * x * slope.second[0]
            solution = converged(task, curve, predicted[None], np.array([there]))
            if solution is None or np.abs(solution[0, :n] - predicted[:n]).max() > FAR:
                step = 0.5 * x
                if step < SHORTEST:
                    raise Stuck(here, now)
                continue
            here, now = there, solution[0]
            slope = slopes(task, curve, now[None], np.array([here]))
            step = 2.0 * x
        postures.append(now)
    return np.array(postures)


def slopes(task: Task, curve: AbstractCurve, z: Array, s: Array) -> Slopes:
    """Return exact derivatives of postures and forces along the curve, from the equations that hold all along it."""
    at = linearised(task, curve, z, s)
    first = -solved(at.by_z, at.by_s)
    second = -solved(at.by_z, curvature(task, curve, z, s, first))
    return Slopes(z, first, second)
