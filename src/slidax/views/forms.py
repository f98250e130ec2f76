"""The forms that pictures are made of: drums, rods, boxes, tubes."""

from __future__ import annotations

import numpy as np
import trimesh

from .solid import Colour, Solid, merged, turn_up

SECTIONS = 32
"""Corners of what is round."""


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
    pieces = pieces or [moved(trimesh.creation.icosphere(1, radius), frame(np.eye(3), points[0]))]
    return merged([Solid(0, np.asarray(piece.vertices), np.asarray(piece.faces), colour) for piece in pieces])[0]


def box(sides: np.ndarray, colour: Colour, rotation: np.ndarray, center: np.ndarray) -> Solid:
    """A box.

    - `sides`: their lengths [3], m.
    - `colour`: of the box.
    - `rotation`, `center`: its axes as columns [3 3], and its middle [3], m.
    """
    return solid(0, trimesh.creation.box(extents=sides), colour, frame(rotation, center))


def drum(radius: float, height: float) -> trimesh.Trimesh:
    """A cylinder along z about the origin, its edges broken.

    - `radius`, `height`: m.
    """
    edge = 0.12 * min(radius, height)
    half = height / 2
    profile = [[0, -half], [radius - edge, -half], [radius, edge - half]]
    profile += [[radius, half - edge], [radius - edge, half], [0, half]]
    return trimesh.creation.revolve(np.array(profile), sections=SECTIONS)


def bone(
    start: np.ndarray, end: np.ndarray, start_radius: float, end_radius: float, *, flat: bool = False
) -> trimesh.Trimesh:
    """A tapered rod with round ends, or a flat one at its start.

    - `start`, `end`: of its axis [3], m.
    - `start_radius`, `end_radius`: there, m.
    - `flat`: whether the start is flat.
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
    """The place of a frame as a matrix [4 4].

    - `rotation`, `place`: its axes as columns [3 3], and its origin [3], m.
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix


def moved(mesh: trimesh.Trimesh, at: np.ndarray) -> trimesh.Trimesh:
    """The same mesh, in another place.

    - `mesh`: is changed.
    - `at`: the place [4 4].
    """
    mesh.apply_transform(at)
    return mesh


def solid(body: int, mesh: trimesh.Trimesh, colour: Colour, at: np.ndarray | None = None) -> Solid:
    """A mesh that a body carries.

    - `body`: its number.
    - `mesh`, `colour`: what is drawn.
    - `at`: its place in the body's frame [4 4]; as it is if not given.
    """
    if at is not None:
        mesh = moved(mesh, at)
    # Edges stay edges, and what is round looks round.
    smooth = trimesh.graph.smooth_shade(mesh, angle=0.5)
    return Solid(body, np.asarray(smooth.vertices), np.asarray(smooth.faces), colour)
