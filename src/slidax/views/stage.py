"""The arm in the room: z up, on the ground, with a camera that sees all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .load import MovedLoad
from .motion import Motion
from .skeleton import Skeleton
from .solid import turn_up

FIELD_OF_VIEW = 0.7
"""Of the camera, from top to bottom [rad]."""

FAR = 2.0
"""How far away a load may have gone to be still in the picture, over the reach."""


@dataclass(frozen=True)
class Stage:
    """The room: z up, the ground at z = 0, or below a table that would lie in it.

    - `rotation`: the base frame's axes in the room as columns [3 3].
    - `height`: of the base above the ground, m.
    - `camera`, `target`: its place, and what it looks at [3], m.
    - `wide_camera`, `wide_target`: the same, for both arms side by side [3], m.
    - `shift`: where the reference stands when it is beside the true arm and not over it [3], m.
    - `size`: of what is to be seen, m.
    - `ground`: height of the ground, m.
    - `table`: lowest and highest corner of the slab whose top is the table [2 3], m; None if there is none.
    """

    rotation: np.ndarray
    height: float
    camera: np.ndarray
    target: np.ndarray
    wide_camera: np.ndarray
    wide_target: np.ndarray
    shift: np.ndarray
    size: float
    ground: float = 0.0
    table: np.ndarray | None = None

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
        return points @ self.rotation.T + self.base


def stage(skeleton: Skeleton, motion: Motion, load: MovedLoad | None = None, table: float | None = None) -> Stage:
    """The room for a film.

    - `skeleton`, `motion`: of the arm.
    - `load`: what the tip carries; None for nothing.
    - `table`: its height above the base, m; None if there is none.
    """
    rotation = turn_up(skeleton.up)
    points = _points(skeleton, motion, load) @ rotation.T
    thick = 0.05 * skeleton.reach
    lowest = min(float(points[:, 2].min()), np.inf if table is None else table)
    height = 4 * thick - lowest if lowest < -thick else 0.0
    fallen = _fallen(load, rotation, -height if table is None else table, FAR * skeleton.reach)
    base = np.array([0.0, 0.0, height])
    seen = np.concatenate([points + base, fallen + base, [np.zeros(3), base]])
    slab = None
    if table is not None:
        tips = np.concatenate([motion.actual_tip, motion.desired_tip]) @ rotation.T
        # An arm whose base is on the table stands on it.
        feet = np.array([[-1, -1, 0], [1, 1, 0]]) * 2 * thick if abs(table) < thick else np.zeros((0, 3))
        slab = _slab(np.concatenate([tips, fallen, feet]) + base, table + height, thick)
        seen = np.concatenate([seen, slab])
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
    # Two faces at one height would flicker.
    ground = 0.0 if slab is None else min(0.0, float(slab[0, 2]) - 0.1 * thick)
    return Stage(rotation, height, camera, target, wide_camera, wide_target, shift, size, ground, slab)


def _slab(above: np.ndarray, top: float, thick: float) -> np.ndarray:
    """Lowest and highest corner of a table below some points [2 3], m."""
    low, high = above.min(axis=0) - 2 * thick, above.max(axis=0) + 2 * thick
    low[2], high[2] = top - 0.3 * thick, top
    return np.stack([low, high])


def _fallen(load: MovedLoad | None, rotation: np.ndarray, floor: float, far: float) -> np.ndarray:
    """Where a load was after it was let go [m 3], m: not below a floor, and not far away."""
    if load is None:
        return np.zeros((0, 3))
    corners = load.corners(load.visible & ~load.carried) @ rotation.T
    near = np.linalg.norm(corners[:, :2], axis=1) < far
    return corners[near & (corners[:, 2] > floor - 0.1 * far)]


def _points(skeleton: Skeleton, motion: Motion, load: MovedLoad | None) -> np.ndarray:
    """All places of joints, tips, the ends of slides and what is carried, in the base frame [k 3]."""
    points = [motion.actual_tip, motion.desired_tip]
    if load is not None:
        points.append(load.corners(load.carried))
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
