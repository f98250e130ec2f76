"""Detection of chattering torques, and their range."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, percentile_filter, uniform_filter1d

SWINGS = 15
"""Swings before and after a swing that it is compared with."""

SAMPLES = 8.0
"""Torques with more samples between turning points do not chatter."""

LONGEST = 40
"""A band ends after this many samples without a turning point."""

SEEN = 0.006
"""A swing below this share of the axis to either side is hidden by the line itself."""

OUTLIER = 3.0
"""A swing this many times larger than usual is a step, not chattering."""


class Band(NamedTuple):
    """A stretch of time in which a torque chatters.

    - `first`, `last`: indices of its samples.
    - `t`: times within it [m], s.
    - `low`, `high`: range of the torque there [m].
    """

    first: int
    last: int
    t: np.ndarray
    low: np.ndarray
    high: np.ndarray


def chatter(t: np.ndarray, y: np.ndarray, height: float) -> list[Band]:
    """The stretches in which a torque alternates from sample to sample, far enough to be visible.

    Swings are measured from their own middle, which follows the motion; a steep transient with a ripple is as narrow as
    its ripple.

    - `t`: increasing [k], s.
    - `y`: torque [k].
    - `height`: of the axis.
    """
    step = np.diff(y)
    turns = np.flatnonzero(step[1:] * step[:-1] < 0) + 1
    if len(turns) <= SWINGS:
        return []
    peaks = y[turns]
    around = np.pad(peaks, 1, mode="reflect")
    middle = 0.25 * around[:-2] + 0.5 * peaks + 0.25 * around[2:]
    swing, window = peaks - middle, 2 * SWINGS + 1
    # Far above the middle of their sizes, for a log of every tenth sample has swings of all sizes; below the largest,
    # which may be the transient.
    usual = percentile_filter(np.abs(swing), 75, window, mode="reflect")
    pace = uniform_filter1d(np.gradient(turns.astype(float)), window, mode="reflect")
    often = (usual > SEEN * height) & (pace <= SAMPLES)
    chatters = uniform_filter1d(often.astype(float), 2 * window, mode="reflect") > 0.4
    steps = np.abs(swing) > OUTLIER * usual
    swing = np.where(steps, 0.0, swing)
    low, high = middle + minimum_filter1d(swing, window), middle + maximum_filter1d(swing, window)
    stretches = []
    breaks = (np.diff(chatters.astype(int)) != 0) | (np.diff(turns) > LONGEST)
    for part in np.split(np.arange(len(turns)), np.flatnonzero(breaks) + 1):
        # A step near an end belongs to the motion before or after it.
        ends = [share[steps[share]] for share in (part[:SWINGS], part[-SWINGS:])]
        part = part[(part > ends[0].max(initial=-1)) & (part < ends[1].min(initial=len(turns)))]
        if len(part) > SWINGS and chatters[part[0]]:
            stretches.append(Band(int(turns[part[0]]), int(turns[part[-1]]), t[turns[part]], low[part], high[part]))
    return stretches
