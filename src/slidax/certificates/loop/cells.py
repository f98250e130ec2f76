"""A grid of κ over a set's range."""

from __future__ import annotations

import math

import numpy as np

from ..each import Floats

STEP = 1.1
"""Largest ratio of two neighbouring κ: deviations in between count as a disturbance."""


def cells_of(kappa: Floats, step: float = STEP) -> tuple[Floats, Floats]:
    """Return some κ for each joint [n j], and the relative deviation of κ around each [n j].

    They divide the range evenly in its logarithm, so that each κ of it is within `1 ± spread` of one of them.

    - `kappa`: least and largest [2 n].
    - `step`: largest ratio of the ends of a cell.
    """
    low, high = np.log(np.asarray(kappa, float))
    count = max(1, math.ceil(float(np.max(high - low)) / math.log(step) - 1e-9))
    half = (high - low) / (2 * count)
    centres = low[:, None] + half[:, None] * (2 * np.arange(count) + 1)
    return np.exp(centres), np.broadcast_to(np.expm1(half)[:, None], centres.shape)
