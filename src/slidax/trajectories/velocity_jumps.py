"""Velocity jumps in a table of positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SIDE = 5
"""Rows on each side of a jump that determine the velocities before and after."""

CLEAR = 12.0
"""A velocity change is a jump if it is this many times the residual of the rows around it."""

PART, LEAST = 0.1, 0.01
"""Smaller changes, as a part of the joint's top speed and in rad/s or m/s, are the rounding of a file."""


class VelocityJump(NamedTuple):
    """A velocity jump.

    - `joint`: index from 0.
    - `row`: index from 0 of the row at the left end of the interval.
    - `before`, `after`: velocities, rad/s or m/s.
    - `end`: -1 at the start of the table, 1 at its end, 0 inside.
    """

    joint: int
    row: int
    before: float
    after: float
    end: int


def velocity_jump(times: NDArray[np.float64], positions: NDArray[np.float64]) -> VelocityJump | None:
    """Return the largest velocity jump, or None.

    Before the first row and after the last one the joints stand still. There is a jump if the velocities of the rows
    before lie on one straight line over time, those of the rows after on another, and within one interval the two lines
    differ much more than a jump in acceleration and the lines' residuals explain. A table of a few waypoints has no
    jump, since it does not define the motion between them.

    - `times`: [k], s, increasing.
    - `positions`: [k n].
    """
    width = np.diff(times)
    velocity = np.diff(positions, axis=0) / width[:, None]
    width = np.concatenate([np.full(SIDE, width[0]), width, np.full(SIDE, width[-1])])
    still = np.zeros((SIDE, positions.shape[1]))
    velocity = np.concatenate([still, velocity, still])
    middle = np.cumsum(width) - width / 2
    gaps = np.arange(SIDE, len(width) - SIDE)
    before = _line(middle, velocity, gaps[:, None] + np.arange(-SIDE, 0), middle[gaps])
    after = _line(middle, velocity, gaps[:, None] + np.arange(1, SIDE + 1), middle[gaps])
    change = np.abs(after.value - before.value)
    top = np.abs(velocity).max(axis=0)
    explained = np.maximum(
        np.abs(after.slope - before.slope) * width[gaps][:, None], CLEAR * np.maximum(before.rest, after.rest)
    )
    jumps = change > np.maximum(explained, np.maximum(LEAST, PART * top))
    if not jumps.any():
        return None
    row, joint = (int(index) for index in np.unravel_index(np.argmax(np.where(jumps, change, 0.0)), change.shape))
    last = len(gaps) - 1
    end = -1 if row == 0 else 1 if row == last else 0
    return VelocityJump(joint, row, float(before.value[row, joint]), float(after.value[row, joint]), end)


class _Line(NamedTuple):
    """Straight lines through some velocities: value at a time, slope, and largest residual."""

    value: NDArray[np.float64]
    slope: NDArray[np.float64]
    rest: NDArray[np.float64]


def _line(
    times: NDArray[np.float64], velocity: NDArray[np.float64], window: NDArray[np.intp], at: NDArray[np.float64]
) -> _Line:
    """Least squares in each window, one line per joint."""
    t = times[window] - at[:, None]
    mean = t.mean(axis=1, keepdims=True)
    weights = (t - mean) / np.sum((t - mean) ** 2, axis=1, keepdims=True)
    v = velocity[window]
    slope = np.einsum("ws,wsn->wn", weights, v)
    centre = v.mean(axis=1)
    value = centre - slope * mean
    rest = np.abs(v - (value[:, None] + slope[:, None] * t[:, :, None])).max(axis=1)
    return _Line(value, slope, rest)
