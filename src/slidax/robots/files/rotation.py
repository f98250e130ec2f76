"""Rotations as MuJoCo writes them, as matrices."""

from __future__ import annotations

import numpy as np

from .loader import mujoco


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """The rotation matrix [3 3] of a quaternion.

    - `quaternion`: scalar first [4].
    """
    matrix = np.zeros(9)
    mujoco().mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation matrix [3 3] about an axis.

    - `axis`: of length 1 [3].
    - `angle`: rad.
    """
    quaternion = np.zeros(4)
    mujoco().mju_axisAngle2Quat(quaternion, axis, angle)
    return matrix_of(quaternion)
