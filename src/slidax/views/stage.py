"""The place of the arm in the room: up is up, the ground is below, and the camera sees all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .motion import Motion
from .skeleton import Skeleton

FIELD_OF_VIEW = 0.7
"""Of the camera, from top to bottom [rad]."""


@dataclass(frozen=True)
class Stage:
    """The room: z up, the ground at z = 0.

    - `rotation`: the base frame's axes in the room as columns [3 3].
    - `height`: of the base above the ground, m.
    - `camera`, `target`: its place, and what it looks at [3], m.
    - `wide_camera`, `wide_target`: the same, for both arms side by side [3], m.
    - `shift`: where the reference stands when it is beside the true arm and not over it [3], m.
    - `size`: of what is to be seen, m.
    """

    rotation: np.ndarray
    height: float
    camera: np.ndarray
    target: np.ndarray
    wide_camera: np.ndarray
    wide_target: np.ndarray
    shift: np.ndarray
    size: float

    @property
    def tile(self) -> float:
        """The side of a tile of the ground: 1, 2 or 5 times a power of ten, m."""
        decade = 10.0 ** np.floor(np.log10(self.size / 10))
        return float(decade * max(step for step in (1, 2, 5) if step * decade <= self.size / 10))

    @property
    def base(self) -> np.ndarray:
        """The place of the base [3], m."""
        return np.array([0.0, 0.0, self.height])

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points of the base frame in the room [k 3], m.

        - `points`: [k 3], m.
        """
        seen: np.ndarray = points @ self.rotation.T + self.base
        return seen


def stage(skeleton: Skeleton, motion: Motion) -> Stage:
    """The room for a film.

    - `skeleton`, `motion`: of the arm.
    """
    rotation = turn_up(skeleton.up)
    points = _points(skeleton, motion) @ rotation.T
    thick = 0.05 * skeleton.reach
    lowest = float(points[:, 2].min())
    height = 4 * thick - lowest if lowest < -thick else 0.0
    seen = np.concatenate([points + np.array([0, 0, height]), [[0, 0, 0], [0, 0, height]]])
    low, high = seen.min(axis=0) - thick, seen.max(axis=0) + thick
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    # An arm that moves in one plane is seen from in front of it.
    flat = np.ptp(points[:, 1]) < 1e-6 * skeleton.reach
    look = np.array([0.28, -1.0, 0.22]) if flat else np.array([0.85, -1.0, 0.5])
    look = look / np.linalg.norm(look)
    right = np.array([-look[1], look[0], 0.0]) / np.hypot(look[0], look[1])
    shift = right * (np.ptp(corners @ right) + 0.1 * skeleton.reach)
    camera, target, size = camera_for(corners, look)
    wide_camera, wide_target, _ = camera_for(np.concatenate([corners, corners + shift]), look)
    return Stage(rotation, height, camera, target, wide_camera, wide_target, shift, size)


def _points(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """All places of joints, tips and the ends of slides, in the base frame [k 3]."""
    points = [motion.actual_tip, motion.desired_tip]
    for poses in (motion.actual, motion.desired):
        points.append(poses.places.reshape(-1, 3))
        for joint in np.flatnonzero(~np.array(skeleton.revolute)):
            points.append(poses.points(int(joint) + 1, np.array([0, 0, -motion.travel[joint]])))
    return np.concatenate(points)


def camera_for(corners: np.ndarray, look: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Where it stands to see all corners in a picture that is a little wider than high, what it looks at, their size.

    - `corners`: [k 3], m.
    - `look`: from what it looks at towards it [3], a unit vector.
    """
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    offsets = corners - middle
    right = np.array([-look[1], look[0], 0.0]) / np.hypot(look[0], look[1])
    aside, above = np.abs(offsets @ right), np.abs(offsets @ np.cross(look, right))
    away = offsets @ look + np.maximum(above, aside / 1.2) / np.tan(FIELD_OF_VIEW / 2)
    size = 2 * float(np.linalg.norm(offsets, axis=1).max())
    return middle + look * 1.08 * float(away.max()), middle, size


def turn_up(up: np.ndarray) -> np.ndarray:
    """The shortest rotation that turns a direction up, to z, [3 3].

    - `up`: a unit vector [3].
    """
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cosine = float(up[2])
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turned: np.ndarray = np.eye(3) + cross + cross @ cross / (1 + cosine)
    return turned
