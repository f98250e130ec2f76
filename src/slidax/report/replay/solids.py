"""Solids of a replay: triangles with a colour, fixed to a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

LINK: Colour = (228, 232, 237)
JOINT: Colour = (88, 102, 118)
STAND: Colour = (150, 159, 169)
ACTUAL: Colour = (0, 114, 178)
DESIRED: Colour = (213, 94, 0)
LOAD: Colour = (158, 138, 118)
TABLE: Colour = (238, 224, 200)
AXES: tuple[Colour, Colour, Colour] = ((200, 60, 50), (70, 150, 70), (50, 90, 190))
"""Colours of links, joints, stand, true arm, reference, payload, table, and the axes of the tip. The true arm and the
reference have the same colours as in the figures.
"""

GHOST = 0.35
"""Opacity of the reference arm."""

SEE_THROUGH = 0.55
"""Opacity of the table, so that a tip below its surface stays visible."""

THINNER = 1e-3
"""Inset of the reference relative to the reach, so that the true arm hides it where both coincide."""


@dataclass(frozen=True)
class Solid:
    """Triangles of one colour.

    - `body`: body that carries them, 0 for the base.
    - `vertices`: [v 3], m, in the body's frame.
    - `faces`: vertex indices of the triangles [f 3].
    - `colour`: red, green and blue, 0 to 255.
    """

    body: int
    vertices: np.ndarray
    faces: np.ndarray
    colour: Colour

    def shrunk(self, depth: float) -> np.ndarray:
        """Return the vertices, moved inwards by `depth` [m], as [v 3], m."""
        corners = self.vertices[self.faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros_like(self.vertices)
        np.add.at(normals, self.faces, areas[:, None, :])
        sizes = np.linalg.norm(normals, axis=1, keepdims=True)
        return self.vertices - depth * normals / np.where(sizes > 0, sizes, 1.0)


def merge_solids(solids: list[Solid]) -> list[Solid]:
    """Join solids with the same body and colour, and return the joined ones, so that the browser moves few objects."""
    groups: dict[tuple[int, Colour], list[Solid]] = {}
    for solid in solids:
        groups.setdefault((solid.body, solid.colour), []).append(solid)
    return [_joined(group) for group in groups.values()]


def _joined(group: list[Solid]) -> Solid:
    starts = np.cumsum([0, *(len(solid.vertices) for solid in group[:-1])])
    faces = [solid.faces + start for solid, start in zip(group, starts, strict=True)]
    vertices = np.concatenate([solid.vertices for solid in group])
    return Solid(group[0].body, vertices, np.concatenate(faces), group[0].colour)


def turn_up(up: np.ndarray) -> np.ndarray:
    """Return the shortest rotation [3 3] from a unit vector `up` [3] to z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cosine = float(up[2])
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)
