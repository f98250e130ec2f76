"""Rotation matrices by MuJoCo's functions."""

from __future__ import annotations

import numpy as np

from .loader import mujoco


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix [3 3] of a quaternion, scalar first [4]."""
    matrix = np.zeros(9)
    mujoco().mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation matrix [3 3] about a unit axis [3] by an angle [rad]."""
    quaternion = np.zeros(4)
    mujoco().mju_axisAngle2Quat(quaternion, axis, angle)
    return matrix_of(quaternion)
