"""An arm of plain shapes: bones between the joints, a housing around each, thinner towards the tip."""

from __future__ import annotations

import numpy as np
import trimesh

from .skeleton import Skeleton
from .solid import ACTUAL, AXES, JOINT, LINK, STAND, TABLE, Colour, Solid, merged
from .stage import Stage, turn_up

SECTIONS = 32
"""Corners of what is round."""


def plain_shapes(skeleton: Skeleton, travel: np.ndarray, size: float) -> list[Solid]:
    """The solids of an arm.

    - `skeleton`: where its joints are.
    - `travel`: how far each joint goes from 0 in a run [n], rad or m; a slide's rod is that long.
    - `size`: of the room that the arm needs, m.
    """
    radii = _radii(skeleton, size)
    solids: list[Solid] = []
    for joint, parent in enumerate(skeleton.parents):
        at = _frame(skeleton.rotations[joint], skeleton.translations[joint])
        r = radii[joint + 1]
        if skeleton.revolute[joint]:
            solids.append(_solid(joint + 1, _drum(1.2 * r, 2.5 * r), JOINT))
        else:
            solids.append(_solid(parent + 1, _drum(1.3 * r, 3.0 * r), JOINT, at))
            rod = _bone(np.zeros(3), np.array([0, 0, -(travel[joint] + 4 * r)]), 0.5 * r, 0.5 * r)
            solids.append(_solid(joint + 1, rod, LINK))
        solids += _link(parent + 1, skeleton.translations[joint], radii[parent + 1], r)
    tip, end = skeleton.tip_joint + 1, radii[skeleton.tip_joint + 1]
    solids += _link(tip, skeleton.tip_translation, end, 0.55 * end)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.75 * end)
    at = _frame(skeleton.tip_rotation, skeleton.tip_translation)
    return [*solids, _solid(tip, ball, ACTUAL, at)]


def tip_axes(skeleton: Skeleton) -> list[Solid]:
    """The axes of the tip's frame: x red, y green, z blue.

    - `skeleton`: of the arm.
    """
    at = _frame(skeleton.tip_rotation, skeleton.tip_translation)
    long = 0.055 * skeleton.reach
    arrows = [_bone(np.zeros(3), axis * long, 0.055 * long, 0.055 * long) for axis in np.eye(3)]
    return [_solid(skeleton.tip_joint + 1, arrow, colour, at) for arrow, colour in zip(arrows, AXES, strict=True)]


def stand(skeleton: Skeleton, stage: Stage, *, foot: bool) -> list[Solid]:
    """What the base stands on: a column from the ground, behind the arm if that swings past its first joint.

    - `skeleton`, `stage`: of the arm.
    - `foot`: whether the base needs a foot even on the ground; a mesh has its own.
    """
    r = _radii(skeleton, stage.size)[0]
    upright = stage.rotation.T
    rim = np.array([0, 0, 0.25 * r])
    if stage.height == 0:
        return [_solid(0, _drum(2.0 * r, 0.5 * r), STAND, _frame(upright, upright @ rim))] if foot else []
    axis = stage.rotation @ skeleton.rotations[0][:, 2]
    behind = np.zeros(3)
    parts: list[trimesh.Trimesh] = []
    if abs(axis[2]) < 0.5:
        behind = axis * (np.sign(axis[1]) or 1.0) * 3.5 * r
        parts.append(_bone(np.zeros(3), behind, 0.9 * r, 0.9 * r))
    # Below an arm that turns on the column, its top must not stand out of the first joint.
    top = 0.0 if np.any(behind) else -1.25 * r
    ground = np.array([behind[0], behind[1], -stage.height])
    parts.append(_bone(ground, np.array([behind[0], behind[1], top]), 1.25 * r, 1.05 * r, flat=True))
    parts.append(_moved(_drum(2.4 * r, 0.5 * r), _frame(np.eye(3), ground + rim)))
    return [_solid(0, part, STAND, _frame(upright, np.zeros(3))) for part in parts]


def tube(points: np.ndarray, radius: float, colour: Colour, *, dashed: bool = False) -> Solid:
    """A thin tube along a path; every other piece of it if dashed.

    - `points`: of the path [k 3], m.
    - `radius`: of the tube, m.
    - `colour`: of the tube.
    """
    step = 2 if dashed else 1
    pairs = [np.stack(pair) for pair in zip(points[:-1:step], points[1::step], strict=False)]
    long = [pair for pair in pairs if np.linalg.norm(pair[1] - pair[0]) > 1e-3 * radius]
    # An arm that holds still has a path all the same: a dot.
    pieces = [trimesh.creation.cylinder(radius, segment=pair, sections=6) for pair in long]
    pieces = pieces or [_moved(trimesh.creation.icosphere(1, radius), _frame(np.eye(3), points[0]))]
    return merged([Solid(0, np.asarray(piece.vertices), np.asarray(piece.faces), colour) for piece in pieces])[0]


def box(sides: np.ndarray, colour: Colour, rotation: np.ndarray, center: np.ndarray) -> Solid:
    """A box.

    - `sides`: their lengths [3], m.
    - `colour`: of the box.
    - `rotation`, `center`: its axes as columns [3 3], and its middle [3], m.
    """
    return _solid(0, trimesh.creation.box(extents=sides), colour, _frame(rotation, center))


def slab(stage: Stage) -> Solid | None:
    """The table in the room; None if there is none.

    - `stage`: the room.
    """
    if stage.table is None:
        return None
    low, high = stage.table
    return box(high - low, TABLE, np.eye(3), (low + high) / 2)


def _radii(skeleton: Skeleton, size: float) -> np.ndarray:
    """Of each body [n+1]: half as thick at the tip as at the base."""
    reach = skeleton.reach
    far = np.zeros(skeleton.joints + 1)
    for joint, parent in enumerate(skeleton.parents):
        far[joint + 1] = far[parent + 1] + np.linalg.norm(skeleton.translations[joint])
    thick: np.ndarray = 0.04 * max(reach, size / 4) * (1 - 0.5 * np.minimum(far / reach, 1.0))
    return thick


def _link(body: int, end: np.ndarray, start_radius: float, end_radius: float) -> list[Solid]:
    if np.linalg.norm(end) < 0.2 * start_radius:
        return []
    return [_solid(body, _bone(np.zeros(3), end, 0.85 * start_radius, 0.85 * end_radius), LINK)]


def _drum(radius: float, height: float) -> trimesh.Trimesh:
    """A cylinder along z about the origin, its edges broken."""
    edge = 0.12 * min(radius, height)
    half = height / 2
    profile = [[0, -half], [radius - edge, -half], [radius, edge - half]]
    profile += [[radius, half - edge], [radius - edge, half], [0, half]]
    drum: trimesh.Trimesh = trimesh.creation.revolve(np.array(profile), sections=SECTIONS)
    return drum


def _bone(
    start: np.ndarray, end: np.ndarray, start_radius: float, end_radius: float, *, flat: bool = False
) -> trimesh.Trimesh:
    """A tapered rod with round ends, or a flat one at its start."""
    length = float(np.linalg.norm(end - start))
    quarter = np.linspace(0, np.pi / 2, 7)
    depth = 0.0 if flat else start_radius
    near = np.stack([start_radius * np.sin(quarter), -depth * np.cos(quarter)], axis=1)
    far = np.stack([end_radius * np.cos(quarter), length + end_radius * np.sin(quarter)], axis=1)
    profile = np.concatenate([near, far])
    profile[[0, -1], 0] = 0.0
    bone: trimesh.Trimesh = trimesh.creation.revolve(profile, sections=SECTIONS)
    return _moved(bone, _frame(turn_up((end - start) / length).T, start))


def _frame(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix


def _moved(mesh: trimesh.Trimesh, at: np.ndarray) -> trimesh.Trimesh:
    mesh.apply_transform(at)
    return mesh


def _solid(body: int, mesh: trimesh.Trimesh, colour: Colour, at: np.ndarray | None = None) -> Solid:
    if at is not None:
        mesh = _moved(mesh, at)
    # Edges stay edges, and what is round looks round.
    smooth = trimesh.graph.smooth_shade(mesh, angle=0.5)
    return Solid(body, np.asarray(smooth.vertices), np.asarray(smooth.faces), colour)
