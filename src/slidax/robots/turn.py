"""Rotation matrices from angles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def by_roll_pitch_yaw(turn: Sequence[float | int]) -> np.ndarray:
    """Return the axes [3 3] of a frame rotated about the fixed axes x, y and z, in this order, by angles in rad."""
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
    """Return the rotation [3 3] about a unit axis [3] by an angle [rad], by Rodrigues' formula."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
