"""Basic shapes: cylinders, rods and boxes."""

from __future__ import annotations

import numpy as np
import trimesh

from .solid import Colour, Solid, turn_up

SECTIONS = 32
"""Sides of a round shape."""


def box(sides: np.ndarray, colour: Colour, rotation: np.ndarray, center: np.ndarray) -> Solid:
    """A box.

    - `sides`: lengths [3], m.
    - `colour`: of the box.
    - `rotation`, `center`: its axes as columns [3 3], and its centre [3], m.
    """
    return solid(0, trimesh.creation.box(extents=sides), colour, frame(rotation, center))


def drum(radius: float, height: float) -> trimesh.Trimesh:
    """A cylinder along z about the origin with chamfered edges; `radius` and `height` in m."""
    edge = 0.12 * min(radius, height)
    half = height / 2
    profile = [[0, -half], [radius - edge, -half], [radius, edge - half]]
    profile += [[radius, half - edge], [radius - edge, half], [0, half]]
    return trimesh.creation.revolve(np.array(profile), sections=SECTIONS)


def bone(
    start: np.ndarray, end: np.ndarray, start_radius: float, end_radius: float, *, flat: bool = False
) -> trimesh.Trimesh:
    """A tapered rod with round ends.

    - `start`, `end`: of its axis [3], m.
    - `start_radius`, `end_radius`: m.
    - `flat`: make the start flat.
    """
    length = float(np.linalg.norm(end - start))
    quarter = np.linspace(0, np.pi / 2, 7)
    depth = 0.0 if flat else start_radius
    near = np.stack([start_radius * np.sin(quarter), -depth * np.cos(quarter)], axis=1)
    far = np.stack([end_radius * np.cos(quarter), length + end_radius * np.sin(quarter)], axis=1)
    profile = np.concatenate([near, far])
    profile[[0, -1], 0] = 0.0
    rod: trimesh.Trimesh = trimesh.creation.revolve(profile, sections=SECTIONS)
    return moved(rod, frame(turn_up((end - start) / length).T, start))


def frame(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The pose of a frame as a matrix [4 4]; `rotation` has its axes as columns, `place` its origin [3], m."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix


def moved(mesh: trimesh.Trimesh, at: np.ndarray) -> trimesh.Trimesh:
    """Transform a `mesh` in place by the pose `at` [4 4]."""
    mesh.apply_transform(at)
    return mesh


def solid(body: int, mesh: trimesh.Trimesh, colour: Colour, at: np.ndarray | None = None) -> Solid:
    """A mesh on a `body`; `at` is its pose in the body's frame [4 4], identity by default."""
    if at is not None:
        mesh = moved(mesh, at)
    # Edges stay edges, and what is round looks round.
    smooth = trimesh.graph.smooth_shade(mesh, angle=0.5)
    return Solid(body, np.asarray(smooth.vertices), np.asarray(smooth.faces), colour)
