"""Where a torque chatters, and between which heights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, percentile_filter, uniform_filter1d

SWINGS = 15
"""A swing is judged among so many before and after it."""

SAMPLES = 8.0
"""Torques that take more samples from one turn to the next move, and do not chatter."""

LONGEST = 40
"""After so many samples without a turn a band is over."""

SEEN = 0.006
"""A swing that is smaller than this share of the axis to either side is hidden by the line itself."""

OUTLIER = 3.0
"""What swings so many times farther than usual is a step and no chattering."""


class Band(NamedTuple):
    """A stretch of time in which a torque chatters.

    - `first`, `last`: numbers of its first and its last sample.
    - `t`: times within it [m], s.
    - `low`, `high`: between which heights it chatters there, [m].
    """

    first: int
    last: int
    t: np.ndarray
    low: np.ndarray
    high: np.ndarray


def chatter(t: np.ndarray, y: np.ndarray, height: float) -> list[Band]:
    """The stretches in which a torque goes to and fro from sample to sample, far enough to be seen.

    The swings are measured from their own middle, which follows the motion: so a steep transient with a ripple on it is
    as narrow as its ripple.

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
    found = []
    breaks = (np.diff(chatters.astype(int)) != 0) | (np.diff(turns) > LONGEST)
    for part in np.split(np.arange(len(turns)), np.flatnonzero(breaks) + 1):
        # A step near an end belongs to the motion before or after it.
        ends = [share[steps[share]] for share in (part[:SWINGS], part[-SWINGS:])]
        part = part[(part > ends[0].max(initial=-1)) & (part < ends[1].min(initial=len(turns)))]
        if len(part) > SWINGS and chatters[part[0]]:
            found.append(Band(int(turns[part[0]]), int(turns[part[-1]]), t[turns[part]], low[part], high[part]))
    return found
