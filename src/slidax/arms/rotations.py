"""Rotations as matrices, quaternions, angles about an axis, and roll, pitch and yaw."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .curves import Array


def rotation_by_roll_pitch_yaw(angles: Sequence[float | int]) -> np.ndarray:
    """Return the rotation matrix [3 3] for roll, pitch, yaw [rad]: turns about the fixed axes x, y, z in this order."""
    roll, pitch, yaw = (float(angle) for angle in angles)
    cr, sr, cp, sp, cy, sy = (f(angle) for angle in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation [3 3] about a unit axis [3] by an angle [rad], by Rodrigues' formula."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def matrix_of(quaternion: Array) -> Array:
    """Return the rotation matrix [3 3] of a unit quaternion w, x, y, z [4]."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: Array) -> Array:
    """Return the unit quaternion w, x, y, z with w >= 0 [4] of a rotation matrix [3 3]."""
    r = rotation
    # Each row is 4 times one component times all components; the row of the largest component loses the fewest digits.
    squares = np.array(
        [
            [1 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1 + r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[2, 1] + r[1, 2]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], 1 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    row = squares[int(np.argmax(np.diag(squares)))]
    quaternion = row / np.linalg.norm(row)
    return quaternion if quaternion[0] >= 0 else -quaternion


def axis_and_angle(rotation: Array) -> tuple[Array, float]:
    """Return a rotation's unit axis [3] and its angle in [0, pi], rad; any axis for the identity."""
    w, *vector = quaternion_of(rotation)
    size = float(np.linalg.norm(vector))
    if size < 1e-15:
        return np.array([0.0, 0.0, 1.0]), 0.0
    return np.asarray(vector) / size, 2.0 * float(np.arctan2(size, w))


def angle_between(first: Array, second: Array) -> Array:
    """Return the angle of the rotation between two orientations [... 3 3], rad."""
    # With the angle a, the difference has the Frobenius norm √8 sin(a/2), which keeps the digits of a small angle.
    half_sine = np.sqrt(np.sum((first - second) ** 2, axis=(-2, -1)) / 8.0)
    return 2.0 * np.arcsin(np.minimum(half_sine, 1.0))
