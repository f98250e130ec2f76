"""Plain shapes for an arm: rods between the joints and a cylinder at each joint, thinner towards the tip."""

from __future__ import annotations

import numpy as np
import trimesh

from .forms import bone, box, drum, frame, moved, solid
from .skeleton import Skeleton
from .solid import ACTUAL, AXES, JOINT, LINK, STAND, TABLE, Solid
from .stage import Stage


def plain_shapes(skeleton: Skeleton, travel: np.ndarray, size: float) -> list[Solid]:
    """Shapes of the links and joints.

    - `skeleton`: of the arm.
    - `travel`: largest distance of each joint from 0 in a run [n], rad or m; the rod of a prismatic joint is that long.
    - `size`: of the workspace, m.
    """
    radii = _radii(skeleton, size)
    solids: list[Solid] = []
    for joint, parent in enumerate(skeleton.parents):
        at = frame(skeleton.rotations[joint], skeleton.translations[joint])
        r = radii[joint + 1]
        if skeleton.revolute[joint]:
            solids.append(solid(joint + 1, drum(1.2 * r, 2.5 * r), JOINT))
        else:
            solids.append(solid(parent + 1, drum(1.3 * r, 3.0 * r), JOINT, at))
            rod = bone(np.zeros(3), np.array([0, 0, -(travel[joint] + 4 * r)]), 0.5 * r, 0.5 * r)
            solids.append(solid(joint + 1, rod, LINK))
        solids += _link(parent + 1, skeleton.translations[joint], radii[parent + 1], r)
    tip, end = skeleton.tip_joint + 1, radii[skeleton.tip_joint + 1]
    solids += _link(tip, skeleton.tip_translation, end, 0.55 * end)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.75 * end)
    at = frame(skeleton.tip_rotation, skeleton.tip_translation)
    return [*solids, solid(tip, ball, ACTUAL, at)]


def tip_axes(skeleton: Skeleton) -> list[Solid]:
    """Axes of the tip frame of a `skeleton`: x red, y green, z blue."""
    at = frame(skeleton.tip_rotation, skeleton.tip_translation)
    long = 0.055 * skeleton.reach
    arrows = [bone(np.zeros(3), axis * long, 0.055 * long, 0.055 * long) for axis in np.eye(3)]
    return [solid(skeleton.tip_joint + 1, arrow, colour, at) for arrow, colour in zip(arrows, AXES, strict=True)]


def stand(skeleton: Skeleton, stage: Stage, *, foot: bool) -> list[Solid]:
    """Column from the ground to the base, placed behind an arm that swings past its first joint.

    - `skeleton`, `stage`: the arm and its surroundings.
    - `foot`: add a foot also where the base is on the ground; meshes have their own.
    """
    r = _radii(skeleton, stage.size)[0]
    upright = stage.rotation.T
    rim = np.array([0, 0, 0.25 * r])
    if stage.height == 0:
        return [solid(0, drum(2.0 * r, 0.5 * r), STAND, frame(upright, upright @ rim))] if foot else []
    axis = stage.rotation @ skeleton.rotations[0][:, 2]
    behind = np.zeros(3)
    parts: list[trimesh.Trimesh] = []
    if abs(axis[2]) < 0.5:
        behind = axis * (np.sign(axis[1]) or 1.0) * 3.5 * r
        parts.append(bone(np.zeros(3), behind, 0.9 * r, 0.9 * r))
    # Below an arm that turns on the column, its top must not stand out of the first joint.
    top = 0.0 if np.any(behind) else -1.25 * r
    ground = np.array([behind[0], behind[1], -stage.height])
    parts.append(bone(ground, np.array([behind[0], behind[1], top]), 1.25 * r, 1.05 * r, flat=True))
    parts.append(moved(drum(2.4 * r, 0.5 * r), frame(np.eye(3), ground + rim)))
    return [solid(0, part, STAND, frame(upright, np.zeros(3))) for part in parts]


def slab(stage: Stage) -> Solid | None:
    """The table of a `stage`, or None."""
    if stage.table is None:
        return None
    low, high = stage.table
    return box(high - low, TABLE, np.eye(3), (low + high) / 2)


def _radii(skeleton: Skeleton, size: float) -> np.ndarray:
    """Radius of each body [n+1]; half as thick at the tip as at the base."""
    reach = skeleton.reach
    far = np.zeros(skeleton.joints + 1)
    for joint, parent in enumerate(skeleton.parents):
        far[joint + 1] = far[parent + 1] + np.linalg.norm(skeleton.translations[joint])
    return 0.04 * max(reach, size / 4) * (1 - 0.5 * np.minimum(far / reach, 1.0))


def _link(body: int, end: np.ndarray, start_radius: float, end_radius: float) -> list[Solid]:
    if np.linalg.norm(end) < 0.2 * start_radius:
        return []
    return [solid(body, bone(np.zeros(3), end, 0.85 * start_radius, 0.85 * end_radius), LINK)]
