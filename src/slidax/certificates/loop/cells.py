"""The κ of a set as some of them, each with what lies around it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

STEP = 1.1
"""From a κ to the next at most: what lies between is counted as a push of the joint by itself."""


def cells_of(kappa: Floats, step: float = STEP) -> tuple[Floats, Floats]:
    """Some κ for each joint [n j], and by how much of itself the κ around each may be otherwise [n j].

    They divide the range evenly in its logarithm, so that each κ of it is within `1 ± spread` of one of them.

    - `kappa`: least and largest [2 n].
    - `step`: ratio of the ends of a cell, at most.
    """
    low, high = np.log(np.asarray(kappa, float))
    count = max(1, math.ceil(float(np.max(high - low)) / math.log(step) - 1e-9))
    half = (high - low) / (2 * count)
    centres = low[:, None] + half[:, None] * (2 * np.arange(count) + 1)
    return np.exp(centres), np.broadcast_to(np.expm1(half)[:, None], centres.shape)
