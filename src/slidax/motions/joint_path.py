"""Joint motion for one move of the tool: quintics through postures along its curve.

A posture is the vector of joint positions q [n]. `PoseTask` computes it by an optimisation with the tool's pose as
constraint. The Lagrange multipliers of the m constraints [m] are called forces on the tool.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from slidax.arms.curves import AbstractCurve, Array
from slidax.arms.inverse import PoseTask, curvature, linearise_task, solve_singular, solve_task, tool_errors
from slidax.core.errors import DefinitionError

from .moves import TimedCurve, TimeLaw
from .splines import quintic_hermite

FAR = 0.05
"""Largest deviation of the next posture from its prediction, rad or m; farther away it may be another solution."""

SHORTEST = 1e-5
"""Shortest step along a curve, as a fraction of the curve; the branch ends if a step must be shorter."""


class PathEnd(Exception):
    """Raised if the search finds no posture beyond a point of the curve.

    - `s`: curve parameter of the last point with a posture, in [0, 1].
    - `z`: posture and forces on the tool at this point [n + m].
    """

    def __init__(self, s: float, z: Array) -> None:
        super().__init__()
        self.s, self.z = s, z


class BranchPoints(NamedTuple):
    """k points of a branch: postures that change continuously as the tool moves along its curve.

    - `z`: posture and forces on the tool at each point [k n+m].
    - `first`, `second`: first and second derivatives of `z` with respect to the curve parameter [k n+m].
    """

    z: Array
    first: Array
    second: Array


def continue_branch(task: PoseTask, curve: AbstractCurve, z: Array, s: Array) -> Array:
    """Return postures and forces on the tool at points of a curve [k n+m], from a continuous path along the curve.

    - `z`: posture and forces at the curve's start [n + m], a solution of `PoseTask`.
    - `s`: curve parameters of the points, >= 0, not decreasing [k].

    Raises PathEnd if the search finds no next posture.
    """
    n = task.posture.size
    postures, current_s, current_z = [], 0.0, z
    slope = branch_derivatives(task, curve, current_z[None], np.array([current_s]))
    for point in s:
        step = float(point) - current_s
        while current_s < point:
            step = min(step, float(point) - current_s)
            # The last step ends at the point itself.
            next_s = float(point) if float(point) - current_s - step < 1e-12 else current_s + step
            x = next_s - current_s
            predicted = current_z + x * slope.first[0] + 0.5 * x * x * slope.second[0]
            solution = solve_task(task, curve, predicted[None], np.array([next_s]))
            if solution is None or np.abs(solution[0, :n] - predicted[:n]).max() > FAR:
                step = 0.5 * x
                if step < SHORTEST:
                    raise PathEnd(current_s, current_z)
                continue
            current_s, current_z = next_s, solution[0]
            slope = branch_derivatives(task, curve, current_z[None], np.array([current_s]))
            step = 2.0 * x
        postures.append(current_z)
    return np.array(postures)


def branch_derivatives(task: PoseTask, curve: AbstractCurve, z: Array, s: Array) -> BranchPoints:
    """Return points of a branch with their exact derivatives, by implicit differentiation.

    - `z`: postures and forces on the tool at the points [k n+m].
    - `s`: curve parameters of the points [k].
    """
    linear = linearise_task(task, curve, z, s)
    first = -solve_singular(linear.by_z, linear.by_s)
    second = -solve_singular(linear.by_z, curvature(task, curve, z, s, first))
    return BranchPoints(z, first, second)


INITIAL_PIECES = 4
"""Number of pieces in each phase of a time law before the refinement halves any piece."""

MOST_PIECES = 4000
"""Most pieces in one move."""

BETWEEN = (0.15, 0.3, 0.5, 0.7, 0.85)
"""Times in each piece at which the tool's error is checked, as fractions of the piece."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint motion for one move, as quintics between knots.

    - `law`: curve parameter as a function of time.
    - `times`: knots, from 0 on [k], s.
    - `branch`: postures and forces on the tool at the knots, with derivatives.
    - `position_error`, `rotation_error`: largest errors of the tool, in the pieces and at the knots, m and rad.
    - `joints`: number of joints n.
    """

    law: TimeLaw
    times: Array
    branch: BranchPoints
    position_error: float
    rotation_error: float
    joints: int

    def stretched(self, factor: float) -> JointPath:
        """Return the same path with all times multiplied by a factor."""
        law = self.law.stretched(factor)
        return JointPath(law, self.times * factor, self.branch, self.position_error, self.rotation_error, self.joints)

    @property
    def coefficients(self) -> Array:
        """Coefficients of the quintics, highest power first [6 k-1 n]."""
        return quintic_hermite(self.times, *_at_knots(self.law, self.times, self.branch, self.joints))


def joint_path(task: PoseTask, move: TimedCurve, z: Array, tolerance: float) -> JointPath:
    """Return the joint motion for one move.

    - `z`: posture and forces on the tool at the start [n + m].
    - `tolerance`: largest error of the tool between knots, in addition to the error at the knots, m and rad.

    Raises PathEnd if the search finds no next posture, DefinitionError if the motion needs too many pieces.
    """
    n, law = task.posture.size, move.law
    ends = law.times
    parts = [np.linspace(a, b, INITIAL_PIECES, endpoint=False) for a, b in pairwise(ends)]
    times = np.concatenate([*parts, ends[-1:]])
    s = law.at(times)[0]
    branch = branch_derivatives(task, move.curve, continue_branch(task, move.curve, z, s), s)
    at_knots = list(tool_errors(task, move.curve, branch.z[:, :n], s))
    checked: set[tuple[float, float]] = set()
    largest = [float(errors.max()) for errors in at_knots]
    while True:
        coefficients = quintic_hermite(times, *_at_knots(law, times, branch, n))
        width = np.diff(times)
        left = np.array([k for k, t in enumerate(times[:-1]) if (t, width[k]) not in checked], dtype=int)
        if not len(left):
            break
        inside = times[left, None] + width[left, None] * np.array(BETWEEN)
        q = evaluate_pieces(coefficients[:, left], inside - times[left, None])
        tool_error = tool_errors(task, move.curve, q.reshape(-1, n), law.at(inside.ravel())[0])
        bad = np.zeros(len(left), dtype=bool)
        worst = []
        for errors, knots in zip(tool_error, at_knots, strict=True):
            at_ends = np.maximum(knots[left], knots[left + 1])
            errors = errors.reshape(len(left), -1).max(axis=1)
            bad |= errors > tolerance + 1.05 * at_ends
            worst.append(errors)
        good = left[~bad]
        checked |= {(times[k], width[k]) for k in good}
        if len(good):
            largest = [max(a, float(e[~bad].max())) for a, e in zip(largest, worst, strict=True)]
        halved = left[bad]
        if not len(halved):
            break
        if len(times) + len(halved) > MOST_PIECES:
            raise DefinitionError(
                f"the motion needs more than {MOST_PIECES} pieces to keep the tool within {tolerance:g} m and rad: "
                "raise `tolerance`, or keep away from singularities"
            )
        middle = times[halved] + 0.5 * width[halved]
        guess = 0.5 * (branch.z[halved] + branch.z[halved + 1])
        guess[:, :n] = evaluate_pieces(coefficients[:, halved], 0.5 * width[halved, None])[:, 0]
        point = law.at(middle)[0]
        new = solve_task(task, move.curve, guess, point)
        if new is None or np.abs(new[:, :n] - guess[:, :n]).max() > 0.1:
            new = continue_branch(task, move.curve, z, point)
        more = branch_derivatives(task, move.curve, new, point)
        order = np.argsort(np.concatenate([times, middle]), kind="stable")
        times = np.concatenate([times, middle])[order]
        branch = BranchPoints(*(np.concatenate([a, b])[order] for a, b in zip(branch, more, strict=True)))
        there = tool_errors(task, move.curve, more.z[:, :n], point)
        at_knots = [np.concatenate([a, b])[order] for a, b in zip(at_knots, there, strict=True)]
        largest = [max(a, float(b.max())) for a, b in zip(largest, there, strict=True)]
    return JointPath(law, times, branch, largest[0], largest[1], n)


def _at_knots(law: TimeLaw, times: Array, branch: BranchPoints, n: int) -> tuple[Array, Array, Array]:
    """Joint positions, velocities and accelerations at the knots, each [k n]."""
    _, rate, bend = (value[:, None] for value in law.at(times))
    q, first, second = (part[:, :n] for part in branch)
    return q, first * rate, second * rate**2 + first * bend


def evaluate_pieces(coefficients: Array, x: Array) -> Array:
    """Return the values [k m n] of k pieces of polynomials at m times in each piece.

    - `coefficients`: [powers k n], highest power first.
    - `x`: times since the start of the piece [k m], s.
    """
    value = np.zeros((*x.shape, coefficients.shape[2]))
    for power in coefficients:
        value = value * x[:, :, None] + power[:, None, :]
    return value
