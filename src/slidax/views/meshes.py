"""The arm as its manufacturer draws it: the meshes of its URDF."""

from __future__ import annotations

import warnings
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from slidax._errors import DefinitionError, DefinitionWarning
from slidax._files import MEGABYTE, require_file
from slidax.robots.files import Drawn, Shape, drawn

from .forms import solid
from .skeleton import Skeleton
from .solid import Solid, merged

LARGEST_MESH = 200 * MEGABYTE
"""Size of a mesh file at most [bytes]."""

LARGEST_GAP = 1e-4
"""Between a link's position by the URDF and by the robot's own frames [m]."""


def find_urdf(skeleton: Skeleton) -> Path | None:
    """Find the URDF with the joint names of a `skeleton` in the package `example-robot-data`, if installed."""
    for folder in _folders():
        for path in sorted(folder.glob("*/urdf/*.urdf")):
            # Most are told apart without reading them as XML.
            text = path.read_text(encoding="utf-8", errors="replace")
            if all(f'"{name}"' in text for name in skeleton.names) and _fits(skeleton, path):
                return path
    return None


def mesh_solids(skeleton: Skeleton, path: Path, *, tools: bool) -> list[Solid]:
    """Read the meshes of a URDF and attach them to the bodies of the robot; empty if no mesh file exists.

    One `DefinitionWarning` names the meshes that are missing or unreadable.

    - `skeleton`: of the robot.
    - `path`: the URDF.
    - `tools`: include links behind fixed joints, such as a hand, which may not belong to the robot.

    Raises DefinitionError if the file has no visual shapes, or belongs to another robot.
    """
    urdf = drawn(path)
    carried = _carried(skeleton, urdf, path)
    still = np.zeros(skeleton.joints)
    places, bodies = _link_places(skeleton, urdf, still), _body_places(skeleton, still)
    own = {urdf.tree.children[name] for name in skeleton.names}
    shapes = [shape for shape in urdf.shapes() if not carried[shape.link] or tools or shape.link in own]
    if not shapes:
        raise DefinitionError(f"{path} has no meshes: leave out `urdf` to draw plain shapes")
    solids: list[Solid] = []
    missing: list[str] = []
    for shape in shapes:
        at = np.linalg.inv(bodies[carried[shape.link]]) @ places[shape.link] @ shape.at
        try:
            solids += [_solid(carried[shape.link], mesh, at, shape) for mesh in _meshes(shape)]
        # Readers of meshes raise what they like.
        except Exception as error:
            missing.append(f"`{shape.file}` of link `{shape.link}` ({_one_line(error)})")
    if missing:
        warnings.warn(f"{path}: not drawn: {', '.join(missing)}", DefinitionWarning, stacklevel=2)
    return merged(solids)


def _meshes(shape: Shape) -> list[trimesh.Trimesh]:
    if shape.kind == "box":
        return [trimesh.creation.box(extents=shape.numbers)]
    if shape.kind == "cylinder":
        radius, length = shape.numbers
        return [trimesh.creation.cylinder(radius=radius, height=length)]
    if shape.kind == "sphere":
        return [trimesh.creation.icosphere(radius=float(shape.numbers[0]))]
    if shape.path is None:
        raise FileNotFoundError("no such file")
    require_file(shape.path, "the mesh", most=LARGEST_MESH)
    scene: Any = trimesh.load(shape.path, force="scene", ignore_broken=True)
    meshes = []
    for node in scene.graph.nodes_geometry:
        placed, name = scene.graph[node]
        mesh = scene.geometry[name].copy()
        mesh.apply_transform(np.diag([*shape.numbers, 1.0]) @ placed)
        meshes.append(mesh)
    if not meshes:
        raise ValueError("no triangles")
    return meshes


def _solid(body: int, mesh: trimesh.Trimesh, at: np.ndarray, shape: Shape) -> Solid:
    # A mesh with a material of its own keeps it.
    visual: Any = mesh.visual
    if shape.colour is not None and isinstance(visual, trimesh.visual.ColorVisuals):
        red, green, blue = (round(255 * part) for part in shape.colour[:3])
    else:
        red, green, blue = (int(part) for part in getattr(visual, "material", visual).main_color[:3])
    return solid(body, trimesh.Trimesh(mesh.vertices, mesh.faces), (red, green, blue), at)


def _one_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _folders() -> list[Path]:
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        return []
    return [Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))]


def _fits(skeleton: Skeleton, path: Path) -> bool:
    try:
        _carried(skeleton, drawn(path), path)
    except DefinitionError:
        return False
    return True


def _carried(skeleton: Skeleton, urdf: Drawn, path: Path) -> dict[str, int]:
    """The body that carries each link; the link must not move on its body."""
    tree = urdf.tree
    missing = [name for name in skeleton.names if name not in tree.joints]
    if missing:
        raise DefinitionError(f"{path} has no joint `{missing[0]}`; it must be the URDF of this robot")
    carried = {tree.root: 0}
    for name in tree.order:
        body = skeleton.names.index(name) + 1 if name in skeleton.names else carried[tree.parents[name]]
        carried[tree.children[name]] = body
    postures = [np.zeros(skeleton.joints), np.linspace(0.3, 0.9, skeleton.joints)]
    relative = []
    for q in postures:
        links, bodies = _link_places(skeleton, urdf, q), _body_places(skeleton, q)
        relative.append({link: np.linalg.inv(bodies[body]) @ links[link] for link, body in carried.items()})
    for link in carried:
        gap = float(np.abs(relative[0][link] - relative[1][link]).max())
        if gap > LARGEST_GAP:
            name = skeleton.names[carried[link] - 1]
            raise DefinitionError(f"in {path}, joint `{name}` moves differently from this robot's, by {gap:.2g} m")
    return carried


def _link_places(skeleton: Skeleton, urdf: Drawn, q: np.ndarray) -> dict[str, np.ndarray]:
    return urdf.places(dict(zip(skeleton.names, q.tolist(), strict=True)))


def _body_places(skeleton: Skeleton, q: np.ndarray) -> np.ndarray:
    poses = skeleton.poses(q[None])
    places = np.tile(np.eye(4), (skeleton.joints + 1, 1, 1))
    places[:, :3, :3], places[:, :3, 3] = poses.rotations[0], poses.places[0]
    return places
