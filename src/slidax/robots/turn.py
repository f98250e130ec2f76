"""Rotations by angles, as matrices."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def by_roll_pitch_yaw(turn: Sequence[float | int]) -> np.ndarray:
    """The axes of a frame that is turned about x, y and z of the frame before it, in this order [3 3].

    - `turn`: the three angles, rad.
    """
    roll, pitch, yaw = (float(angle) for angle in turn)
    cr, sr, cp, sp, cy, sy = (f(angle) for angle in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation about an axis [3 3], by Rodrigues' formula.

    - `axis`: of length 1 [3].
    - `angle`: rad.
    """
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
