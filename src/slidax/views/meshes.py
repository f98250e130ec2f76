"""The arm as its maker drew it: the meshes that its URDF names."""

from __future__ import annotations

from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yourdfpy

from slidax._errors import DefinitionError

from .skeleton import Skeleton
from .solid import Solid, merged

LARGEST_GAP = 1e-4
"""Between where a link is by its URDF and where it is by the robot's own frames [m]."""


def find_urdf(skeleton: Skeleton) -> Path | None:
    """The URDF with meshes of a robot with these joints, in the package `example-robot-data` if it is installed.

    - `skeleton`: of the robot; the names of its joints are looked for.
    """
    for folder in _folders():
        for path in sorted(folder.glob("*/urdf/*.urdf")):
            # Most are told apart without reading them as XML.
            text = path.read_text(encoding="utf-8", errors="replace")
            if all(f'"{name}"' in text for name in skeleton.names) and _fits(skeleton, path):
                return path
    return None


def mesh_solids(skeleton: Skeleton, path: Path, *, tools: bool) -> list[Solid]:
    """The meshes of a URDF, on the bodies of the robot that carry them.

    - `skeleton`: of the robot.
    - `path`: the URDF.
    - `tools`: also those of links behind fixed joints, such as a hand, which may be no part of the robot.

    Raises DefinitionError if the file has no meshes, or is of another robot.
    """
    urdf = _load(path, meshes=True)
    carried = _carried(skeleton, urdf, path)
    scene = urdf.scene
    places = _link_places(skeleton, urdf, np.zeros(skeleton.joints))
    bodies = _body_places(skeleton, np.zeros(skeleton.joints))
    solids: list[Solid] = []
    for node in scene.graph.nodes_geometry:
        placed, geometry = scene.graph[node]
        link = _link_of(scene, node, places)
        if carried[link] and not tools and urdf.joint_map[skeleton.names[carried[link] - 1]].child != link:
            continue
        given = scene.geometry[geometry]
        mesh = trimesh.Trimesh(given.vertices, given.faces)
        mesh.apply_transform(np.linalg.inv(bodies[carried[link]]) @ placed)
        smooth = trimesh.graph.smooth_shade(mesh, angle=0.5)
        solids.append(Solid(carried[link], np.asarray(smooth.vertices), np.asarray(smooth.faces), _colour(given)))
    if not solids:
        raise DefinitionError(f"{path} names no meshes that are there; leave `urdf` out for plain shapes")
    return merged(solids)


def _folders() -> list[Path]:
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        return []
    return [Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))]


def _load(path: Path, *, meshes: bool) -> yourdfpy.URDF:
    try:
        return yourdfpy.URDF.load(
            str(path),
            build_scene_graph=True,
            load_meshes=meshes,
            filename_handler=partial(yourdfpy.filename_handler_magic, dir=str(path.parent)),
        )
    except (OSError, ValueError, KeyError) as error:
        raise DefinitionError(f"{path} can't be read as a URDF with meshes: {error}") from error


def _fits(skeleton: Skeleton, path: Path) -> bool:
    try:
        _carried(skeleton, _load(path, meshes=False), path)
    except DefinitionError:
        return False
    return True


def _carried(skeleton: Skeleton, urdf: yourdfpy.URDF, path: Path) -> dict[str, int]:
    """The body that carries each link, which must stay where it is on its body, however the arm stands."""
    missing = [name for name in skeleton.names if name not in urdf.joint_map]
    if missing:
        raise DefinitionError(f"{path} has no joint `{missing[0]}`; it must be the URDF of this robot")
    joint_before = {joint.child: joint for joint in urdf.robot.joints}
    carried: dict[str, int] = {}
    for link in urdf.link_map:
        above = link
        while above in joint_before and joint_before[above].name not in skeleton.names:
            above = joint_before[above].parent
        carried[link] = skeleton.names.index(joint_before[above].name) + 1 if above in joint_before else 0
    postures = [np.zeros(skeleton.joints), np.linspace(0.3, 0.9, skeleton.joints)]
    seen = []
    for q in postures:
        links, bodies = _link_places(skeleton, urdf, q), _body_places(skeleton, q)
        seen.append({link: np.linalg.inv(bodies[body]) @ links[link] for link, body in carried.items()})
    for link in carried:
        gap = float(np.abs(seen[0][link] - seen[1][link]).max())
        if gap > LARGEST_GAP:
            name = skeleton.names[carried[link] - 1]
            raise DefinitionError(f"in {path}, joint `{name}` moves unlike that of this robot, by {gap:.2g} m")
    return carried


def _link_places(skeleton: Skeleton, urdf: yourdfpy.URDF, q: np.ndarray) -> dict[str, np.ndarray]:
    urdf.update_cfg(dict(zip(skeleton.names, q, strict=True)))
    return {link: np.asarray(urdf.get_transform(link, urdf.base_link)) for link in urdf.link_map}


def _body_places(skeleton: Skeleton, q: np.ndarray) -> np.ndarray:
    poses = skeleton.poses(q[None])
    places = np.tile(np.eye(4), (skeleton.joints + 1, 1, 1))
    places[:, :3, :3], places[:, :3, 3] = poses.rotations[0], poses.places[0]
    return places


def _link_of(scene: trimesh.Scene, node: str, links: dict[str, np.ndarray]) -> str:
    while node not in links:
        node = scene.graph.transforms.parents[node]
    return node


def _colour(mesh: trimesh.Trimesh) -> tuple[int, int, int]:
    visual: Any = mesh.visual
    red, green, blue = getattr(visual, "material", visual).main_color[:3]
    return int(red), int(green), int(blue)
