"""The surroundings of the arm: z up, ground, table, and a camera that sees everything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .load import PayloadMotion
from .motion import SampledRun
from .skeleton import Skeleton
from .solid import turn_up

FIELD_OF_VIEW = 0.7
"""Vertical opening angle of the camera [rad]."""

FAR = 2.0
"""A payload farther from the base than this multiple of the reach is not kept in view."""


@dataclass(frozen=True)
class Stage:
    """The surroundings: z up, the ground at z = 0, or lower if the table would intersect it.

    - `rotation`: axes of the base frame as columns [3 3].
    - `height`: of the base above the ground, m.
    - `camera`, `target`: positions of the camera and of the point that it looks at [3], m.
    - `wide_camera`, `wide_target`: the same with both arms side by side [3], m.
    - `shift`: offset of the reference when it is beside the true arm [3], m.
    - `size`: diameter of the visible scene, m.
    - `ground`: height of the ground, m.
    - `table`: lowest and highest corner of the table [2 3], m; None if there is none.
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
        """Side of a ground tile: 1, 2 or 5 times a power of ten, m."""
        decade = 10.0 ** np.floor(np.log10(self.size / 10))
        return float(decade * max(step for step in (1, 2, 5) if step * decade <= self.size / 10))

    @property
    def base(self) -> np.ndarray:
        """Position of the base [3], m."""
        return np.array([0.0, 0.0, self.height])

    def points(self, points: np.ndarray) -> np.ndarray:
        """Transform `points` [k 3], m, from the base frame."""
        return points @ self.rotation.T + self.base


def make_stage(
    skeleton: Skeleton, motion: SampledRun, payload: PayloadMotion | None = None, table: float | None = None
) -> Stage:
    """Surroundings for an arm and its `motion`; `table` is the height of a table above the base, m."""
    rotation = turn_up(skeleton.up)
    points = _points(skeleton, motion, payload) @ rotation.T
    thick = 0.05 * skeleton.reach
    lowest = min(float(points[:, 2].min()), np.inf if table is None else table)
    height = 4 * thick - lowest if lowest < -thick else 0.0
    fallen = _fallen(payload, rotation, -height if table is None else table, FAR * skeleton.reach)
    base = np.array([0.0, 0.0, height])
    visible = np.concatenate([points + base, fallen + base, [np.zeros(3), base]])
    slab = None
    if table is not None:
        tips = np.concatenate([motion.actual_tip, motion.desired_tip]) @ rotation.T
        # An arm whose base is on the table stands on it.
        feet = np.array([[-1, -1, 0], [1, 1, 0]]) * 2 * thick if abs(table) < thick else np.zeros((0, 3))
        slab = _slab(np.concatenate([tips, fallen, feet]) + base, table + height, thick)
        visible = np.concatenate([visible, slab])
    low, high = visible.min(axis=0) - thick, visible.max(axis=0) + thick
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
    """Lowest and highest corner of a table below the points `above` [2 3], m."""
    low, high = above.min(axis=0) - 2 * thick, above.max(axis=0) + 2 * thick
    low[2], high[2] = top - 0.3 * thick, top
    return np.stack([low, high])


def _fallen(payload: PayloadMotion | None, rotation: np.ndarray, floor: float, far: float) -> np.ndarray:
    """Corners of a released payload [m 3], m, that are above the floor and near."""
    if payload is None:
        return np.zeros((0, 3))
    corners = payload.corners(payload.visible & ~payload.carried) @ rotation.T
    near = np.linalg.norm(corners[:, :2], axis=1) < far
    return corners[near & (corners[:, 2] > floor - 0.1 * far)]


def _points(skeleton: Skeleton, motion: SampledRun, payload: PayloadMotion | None) -> np.ndarray:
    """All positions of joints, tips, ends of prismatic joints, and carried payload in the base frame [k 3]."""
    points = [motion.actual_tip, motion.desired_tip]
    if payload is not None:
        points.append(payload.corners(payload.carried))
    for poses in (motion.actual, motion.desired):
        points.append(poses.places.reshape(-1, 3))
        for joint in np.flatnonzero(~np.array(skeleton.revolute)):
            points.append(poses.points(int(joint) + 1, np.array([0, 0, -motion.travel[joint]])))
    return np.concatenate(points)


def camera_for(corners: np.ndarray, look: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Camera position, target and diameter for `corners` [k 3], m, seen along the unit vector `look`."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    offsets = corners - middle
    right = np.array([-look[1], look[0], 0.0]) / np.hypot(look[0], look[1])
    aside, above = np.abs(offsets @ right), np.abs(offsets @ np.cross(look, right))
    away = offsets @ look + np.maximum(above, aside / 1.2) / np.tan(FIELD_OF_VIEW / 2)
    size = 2 * float(np.linalg.norm(offsets, axis=1).max())
    return middle + look * 1.08 * float(away.max()), middle, size
