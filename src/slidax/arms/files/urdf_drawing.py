"""Shapes of a URDF file and their poses, for drawing."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slidax.core.errors import DefinitionError, locate_errors, parse_number

from ..rotations import rotation_about, rotation_by_roll_pitch_yaw
from .reading import mesh_paths
from .source import read_robot_file
from .urdf_tree import UrdfTree, urdf_tree

SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


@dataclass(frozen=True)
class Shape:
    """A shape on a link.

    - `link`: name of the link.
    - `kind`: "box", "cylinder", "sphere" or "mesh".
    - `at`: pose in the link's frame [4 4].
    - `numbers`: sides of a box, radius and length of a cylinder, or radius of a sphere, m; for a mesh, the scale along
      its axes [3].
    - `colour`: red, green, blue, opacity, 0 to 1; None if the file has none.
    - `file`: name of the mesh file in the URDF; empty for other shapes.
    - `path`: path of the mesh file; None if it does not exist.
    """

    link: str
    kind: str
    at: np.ndarray
    numbers: np.ndarray
    colour: tuple[float, ...] | None
    file: str = ""
    path: Path | None = None


@dataclass(frozen=True)
class UrdfDrawing:
    """A URDF file for drawing.

    - `tree`: links and joints.
    - `root`: outermost element.
    - `folder`: base of its relative paths.
    """

    tree: UrdfTree
    root: ET.Element
    folder: Path

    def frames(self, q: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Return each link's frame in the base link's frame [4 4].

        - `q`: joint positions by name, rad or m; 0 for others.
        """
        tree = self.tree
        frames = {tree.root: np.eye(4)}
        for name in tree.order:
            joint, moved = tree.joints[name], np.eye(4)
            axis = np.array(_numbers(joint.find("axis"), "xyz", "1 0 0"))
            if joint.get("type") == "prismatic":
                moved[:3, 3] = axis / np.linalg.norm(axis) * q.get(name, 0.0)
            elif joint.get("type") != "fixed":
                moved[:3, :3] = rotation_about(axis / np.linalg.norm(axis), q.get(name, 0.0))
            frames[tree.children[name]] = frames[tree.parents[name]] @ _origin(joint) @ moved
        return frames

    def shapes(self) -> Iterator[Shape]:
        """Yield the visual shapes of all links, also those whose mesh is missing."""
        colours = {element.get("name", ""): _colour(element) for element in self.root.findall("material")}
        for link, element in self.tree.links.items():
            for visual in element.findall("visual"):
                material = visual.find("material")
                colour = None if material is None else _colour(material) or colours.get(material.get("name", ""))
                for shape in visual.iterfind("geometry/*"):
                    yield from self._shape(link, shape, _origin(visual), colour)

    def _shape(self, link: str, shape: ET.Element, at: np.ndarray, colour: tuple[float, ...] | None) -> Iterator[Shape]:
        if shape.tag == "mesh":
            file = shape.get("filename", "").strip()
            path = next((path for path in mesh_paths(file, self.folder) if path.is_file()), None)
            scale = np.broadcast_to(_numbers(shape, "scale", "1 1 1"), 3)
            yield Shape(link, "mesh", at, scale, colour, file, path)
        elif shape.tag in SIZES:
            numbers = [number for name in SIZES[shape.tag] for number in _numbers(shape, name, "0")]
            yield Shape(link, shape.tag, at, np.array(numbers), colour)


def urdf_drawing(path: str | Path) -> UrdfDrawing:
    """Read a URDF file for drawing.

    Raises DefinitionError if it is not readable, or its links do not form a tree.
    """
    file = read_robot_file(path, "robot", "a URDF file is needed")
    with locate_errors(str(path)):
        return UrdfDrawing(urdf_tree(file.root), file.root, file.folder)


def _origin(element: ET.Element) -> np.ndarray:
    frame, origin = np.eye(4), element.find("origin")
    frame[:3, :3] = rotation_by_roll_pitch_yaw(_numbers(origin, "rpy", "0 0 0"))
    frame[:3, 3] = _numbers(origin, "xyz", "0 0 0")
    return frame


def _colour(material: ET.Element) -> tuple[float, ...] | None:
    colour = material.find("color")
    return None if colour is None else tuple(_numbers(colour, "rgba", "0.5 0.5 0.5 1"))


def _numbers(element: ET.Element | None, name: str, otherwise: str) -> list[float]:
    text = otherwise if element is None else element.get(name, otherwise)
    try:
        return [parse_number(word) for word in text.split()]
    except ValueError as error:
        raise DefinitionError(f"{name} must be numbers; got `{text}`") from error
