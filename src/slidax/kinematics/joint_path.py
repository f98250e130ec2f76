"""Joint motion for one move: quintics through postures, as many as the tool's accuracy needs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slidax._errors import DefinitionError
from slidax.trajectories.hermite import quintic_hermite

from .branch import Slopes, continued, slopes
from .moves import Bound
from .newton import converged
from .series import Array
from .task import Task, tool_errors
from .time_law import TimeLaw

FIRST = 4
"""Pieces of each phase of a time law before halving."""

MOST = 4000
"""Pieces of one move."""

BETWEEN = (0.15, 0.3, 0.5, 0.7, 0.85)
"""Points in each piece at which the tool's error is measured."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """The joint motion for one move.

    - `times`: knots, from 0 on [k], s.
    - `branch`: postures and forces at the knots, with their derivatives along the curve.
    - `place_error`, `turn_error`: largest errors of the tool, in the pieces and at the knots, m and rad.
    - `joints`: n.
    """

    law: TimeLaw
    times: Array
    branch: Slopes
    place_error: float
    turn_error: float
    joints: int

    def stretched(self, factor: float) -> JointPath:
        """Return the same path with all times multiplied by a factor."""
        law = self.law.stretched(factor)
        return JointPath(law, self.times * factor, self.branch, self.place_error, self.turn_error, self.joints)

    @property
    def coefficients(self) -> Array:
        """Coefficients of the quintics, highest power first [6 k-1 n]."""
        return quintic_hermite(self.times, *_motion(self.law, self.times, self.branch, self.joints))


def joint_path(task: Task, move: Bound, z: Array, tolerance: float) -> JointPath:
    """Return the joint motion for one move.

    - `z`: posture and forces at the start [n + m].
    - `tolerance`: largest error of the tool between knots beyond the error at the knots, m and rad.

    Raises Stuck where the search finds no next posture, DefinitionError if it needs too many pieces.
    """
    n, law = task.posture.size, move.law
    ends = law.times
    parts = [np.linspace(a, b, FIRST, endpoint=False) for a, b in pairwise(ends)]
    times = np.concatenate([*parts, ends[-1:]])
    s = law.at(times)[0]
    branch = slopes(task, move.curve, continued(task, move.curve, z, s), s)
    at_knots = list(tool_errors(task, move.curve, branch.z[:, :n], s))
    checked: set[tuple[float, float]] = set()
    largest = [float(errors.max()) for errors in at_knots]
    while True:
        coefficients = quintic_hermite(times, *_motion(law, times, branch, n))
        width = np.diff(times)
        left = np.array([k for k, t in enumerate(times[:-1]) if (t, width[k]) not in checked], dtype=int)
        if not len(left):
            break
        inside = times[left, None] + width[left, None] * np.array(BETWEEN)
        q = _evaluated(coefficients[:, left], inside - times[left, None])
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
        if len(times) + len(halved) > MOST:
            raise DefinitionError(
                f"the motion needs more than {MOST} pieces to keep the tool within {tolerance:g} m and rad: raise "
                "`tolerance`, or keep away from singularities"
            )
        middle = times[halved] + 0.5 * width[halved]
        guess = 0.5 * (branch.z[halved] + branch.z[halved + 1])
        guess[:, :n] = _evaluated(coefficients[:, halved], 0.5 * width[halved, None])[:, 0]
        point = law.at(middle)[0]
        new = converged(task, move.curve, guess, point)
        if new is None or np.abs(new[:, :n] - guess[:, :n]).max() > 0.1:
            new = continued(task, move.curve, z, point)
        more = slopes(task, move.curve, new, point)
        order = np.argsort(np.concatenate([times, middle]), kind="stable")
        times = np.concatenate([times, middle])[order]
        branch = Slopes(*(np.concatenate([a, b])[order] for a, b in zip(branch, more, strict=True)))
        there = tool_errors(task, move.curve, more.z[:, :n], point)
        at_knots = [np.concatenate([a, b])[order] for a, b in zip(at_knots, there, strict=True)]
        largest = [max(a, float(b.max())) for a, b in zip(largest, there, strict=True)]
    return JointPath(law, times, branch, largest[0], largest[1], n)


def _motion(law: TimeLaw, times: Array, branch: Slopes, n: int) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations at the knots."""
    _, rate, bend = (value[:, None] for value in law.at(times))
    q, first, second = (part[:, :n] for part in branch)
    return q, first * rate, second * rate**2 + first * bend


def _evaluated(coefficients: Array, x: Array) -> Array:
    """Values of quintics [6 k n] at times within each piece [k m], as [k m n]."""
    value = np.zeros((*x.shape, coefficients.shape[2]))
    for power in coefficients:
        value = value * x[:, :, None] + power[:, None, :]
    return value
