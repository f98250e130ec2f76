"""Shapes of an arm: plain rods and cylinders, or the meshes of its URDF."""

from __future__ import annotations

import warnings
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from slidax.arms.files.urdf_drawing import Shape, UrdfDrawing, urdf_drawing
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.core.files import MEGABYTE, require_file

from .skeleton import Skeleton
from .solids import ACTUAL, AXES, JOINT, LINK, STAND, TABLE, Colour, Solid, merge_solids, turn_up

if TYPE_CHECKING:
    from .drawing import SceneStage


SECTIONS = 32
"""Sides of a round shape."""


def box(sides: np.ndarray, colour: Colour, rotation: np.ndarray, center: np.ndarray) -> Solid:
    """Return a box as a solid on body 0.

    - `sides`: lengths of the sides [3], m.
    - `rotation`, `center`: the box's axes as columns [3 3], and its centre [3], m.
    """
    return solid(0, trimesh.creation.box(extents=sides), colour, frame(rotation, center))


def drum(radius: float, height: float) -> trimesh.Trimesh:
    """Return a cylinder along z about the origin with chamfered edges; `radius` and `height` in m."""
    edge = 0.12 * min(radius, height)
    half = height / 2
    profile = [[0, -half], [radius - edge, -half], [radius, edge - half]]
    profile += [[radius, half - edge], [radius - edge, half], [0, half]]
    return trimesh.creation.revolve(np.array(profile), sections=SECTIONS)


def bone(
    start: np.ndarray, end: np.ndarray, start_radius: float, end_radius: float, *, flat: bool = False
) -> trimesh.Trimesh:
    """Return a tapered rod with round ends.

    - `start`, `end`: ends of the rod's axis [3], m.
    - `start_radius`, `end_radius`: radii at these ends, m.
    - `flat`: True for a flat start.
    """
    length = float(np.linalg.norm(end - start))
    quarter = np.linspace(0, np.pi / 2, 7)
    depth = 0.0 if flat else start_radius
    near = np.stack([start_radius * np.sin(quarter), -depth * np.cos(quarter)], axis=1)
    far = np.stack([end_radius * np.cos(quarter), length + end_radius * np.sin(quarter)], axis=1)
    profile = np.concatenate([near, far])
    profile[[0, -1], 0] = 0.0
    rod: trimesh.Trimesh = trimesh.creation.revolve(profile, sections=SECTIONS)
    return move_mesh(rod, frame(turn_up((end - start) / length).T, start))


def frame(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return a frame's pose as a matrix [4 4]; `rotation` has its axes as columns, `position` is its origin [3], m."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def move_mesh(mesh: trimesh.Trimesh, at: np.ndarray) -> trimesh.Trimesh:
    """Transform a `mesh` in place by the pose `at` [4 4]."""
    mesh.apply_transform(at)
    return mesh


def solid(body: int, mesh: trimesh.Trimesh, colour: Colour, at: np.ndarray | None = None) -> Solid:
    """Return a mesh as a solid on a `body`; `at` is its pose in the body's frame [4 4], identity by default."""
    if at is not None:
        mesh = move_mesh(mesh, at)
    # Keep sharp edges, and shade round surfaces smoothly.
    smooth = trimesh.graph.smooth_shade(mesh, angle=0.5)
    return Solid(body, np.asarray(smooth.vertices), np.asarray(smooth.faces), colour)


def plain_shapes(skeleton: Skeleton, travel: np.ndarray, size: float) -> list[Solid]:
    """Return plain shapes of the links and joints.

    - `skeleton`: skeleton of the arm.
    - `travel`: largest distance of each joint from 0 in a run [m], rad or m; a prismatic joint's rod is that long.
    - `size`: diameter of the visible scene, m; in a large scene the shapes are thicker.
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
    """Return the axes of a `skeleton`'s tip frame as rods: x red, y green, z blue."""
    at = frame(skeleton.tip_rotation, skeleton.tip_translation)
    long = 0.055 * skeleton.reach
    arrows = [bone(np.zeros(3), axis * long, 0.055 * long, 0.055 * long) for axis in np.eye(3)]
    return [solid(skeleton.tip_joint + 1, arrow, colour, at) for arrow, colour in zip(arrows, AXES, strict=True)]


def stand(skeleton: Skeleton, stage: SceneStage, *, foot: bool) -> list[Solid]:
    """Return the column from the ground to the base, placed behind an arm that swings past its first joint.

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
    parts.append(move_mesh(drum(2.4 * r, 0.5 * r), frame(np.eye(3), ground + rim)))
    return [solid(0, part, STAND, frame(upright, np.zeros(3))) for part in parts]


def slab(stage: SceneStage) -> Solid | None:
    """Return the table of a `stage` as a solid; None without a table."""
    if stage.table is None:
        return None
    low, high = stage.table
    return box(high - low, TABLE, np.eye(3), (low + high) / 2)


def _radii(skeleton: Skeleton, size: float) -> np.ndarray:
    """Return the radius of each body [bodies], m; the tip is half as thick as the base."""
    reach = skeleton.reach
    far = np.zeros(skeleton.bodies)
    for joint, parent in enumerate(skeleton.parents):
        far[joint + 1] = far[parent + 1] + np.linalg.norm(skeleton.translations[joint])
    return 0.04 * max(reach, size / 4) * (1 - 0.5 * np.minimum(far / reach, 1.0))


def _link(body: int, end: np.ndarray, start_radius: float, end_radius: float) -> list[Solid]:
    if np.linalg.norm(end) < 0.2 * start_radius:
        return []
    return [solid(body, bone(np.zeros(3), end, 0.85 * start_radius, 0.85 * end_radius), LINK)]


LARGEST_MESH = 200 * MEGABYTE
"""Largest size of a mesh file [bytes]."""

LARGEST_GAP = 1e-4
"""Largest difference between a link's position by the URDF and by the robot's own frames [m]."""


def find_urdf(skeleton: Skeleton) -> Path | None:
    """Return the URDF in the package `example-robot-data` with the joints of a `skeleton`; None without one."""
    for folder in _folders():
        for path in sorted(folder.glob("*/urdf/*.urdf")):
            # A search in the text rules out most files without parsing XML.
            text = path.read_text(encoding="utf-8", errors="replace")
            if all(f'"{name}"' in text for name in skeleton.names) and _fits(skeleton, path):
                return path
    return None


def mesh_solids(skeleton: Skeleton, path: Path, *, tools: bool) -> list[Solid]:
    """Return the shapes of a URDF as solids on the bodies of the robot; empty if no mesh file exists.

    One `DefinitionWarning` names the meshes that are missing or unreadable.

    - `skeleton`, `path`: skeleton of the robot, and its URDF.
    - `tools`: True to draw also links behind fixed joints, such as a hand, which may not belong to the robot.

    Raises DefinitionError if the file has no visual shapes, or belongs to another robot.
    """
    urdf = urdf_drawing(path)
    carried = _carried(skeleton, urdf, path)
    still = np.zeros(skeleton.joints)
    links, bodies = _link_frames(skeleton, urdf, still), _body_frames(skeleton, still)
    own = {urdf.tree.children[name] for name in skeleton.names}
    shapes = [shape for shape in urdf.shapes() if not carried[shape.link] or tools or shape.link in own]
    if not shapes:
        raise DefinitionError(f"{path} has no meshes: leave out `urdf` to draw plain shapes")
    solids: list[Solid] = []
    missing: list[str] = []
    for shape in shapes:
        at = np.linalg.inv(bodies[carried[shape.link]]) @ links[shape.link] @ shape.at
        try:
            solids += [_solid(carried[shape.link], mesh, at, shape) for mesh in _meshes(shape)]
        # Mesh readers raise exceptions of any class.
        except Exception as error:
            missing.append(f"`{shape.file}` of link `{shape.link}` ({_one_line(error)})")
    if missing:
        warnings.warn(f"{path}: not drawn: {', '.join(missing)}", DefinitionWarning, stacklevel=2)
    return merge_solids(solids)


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
        _carried(skeleton, urdf_drawing(path), path)
    except DefinitionError:
        return False
    return True


def _carried(skeleton: Skeleton, urdf: UrdfDrawing, path: Path) -> dict[str, int]:
    """Return the index of the body that carries each link, by name.

    Raises DefinitionError if a joint is missing, or a link moves relative to its body.
    """
    tree = urdf.tree
    missing = [name for name in skeleton.names if name not in tree.joints]
    if missing:
        raise DefinitionError(f"{path} has no joint `{missing[0]}`; give the URDF of this robot")
    carried = {tree.root: 0}
    for name in tree.order:
        body = skeleton.names.index(name) + 1 if name in skeleton.names else carried[tree.parents[name]]
        carried[tree.children[name]] = body
    postures = [np.zeros(skeleton.joints), np.linspace(0.3, 0.9, skeleton.joints)]
    relative = []
    for q in postures:
        links, bodies = _link_frames(skeleton, urdf, q), _body_frames(skeleton, q)
        relative.append({link: np.linalg.inv(bodies[body]) @ links[link] for link, body in carried.items()})
    for link in carried:
        gap = float(np.abs(relative[0][link] - relative[1][link]).max())
        if gap > LARGEST_GAP:
            name = skeleton.names[carried[link] - 1]
            raise DefinitionError(
                f"in {path}, joint `{name}` moves differently from this robot's joint, by {gap:.2g} m: give this "
                "robot's URDF"
            )
    return carried


def _link_frames(skeleton: Skeleton, urdf: UrdfDrawing, q: np.ndarray) -> dict[str, np.ndarray]:
    return urdf.frames(dict(zip(skeleton.names, skeleton.positions(q[None])[0].tolist(), strict=True)))


def _body_frames(skeleton: Skeleton, q: np.ndarray) -> np.ndarray:
    poses = skeleton.poses(q[None])
    frames = np.tile(np.eye(4), (skeleton.bodies, 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = poses.rotations[0], poses.positions[0]
    return frames
