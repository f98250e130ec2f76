"""An arm from a URDF file."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, as_array, known, located, nearest

from ..articulated import Articulated
from ..assemble import assemble
from ..joint import Joint
from .loader import mujoco, reading
from .meshes import Packages, require_mesh
from .rotation import matrix_of
from .source import read
from .urdf_tree import Tree, tree_of
from .urdf_values import CHILDREN, limits_of, number

Armature = float | Sequence[float] | np.ndarray | Mapping[str, float]


def from_urdf(
    source: str | Path,
    *,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    armature: Armature = 0.0,
    packages: Packages = (),
    meshes: bool = True,
    limits: bool = True,
) -> Articulated:
    """An arm from a URDF file, read by MuJoCo (`pip install 'slidax[robots]'`).

    - `source`: path of the file, or its text.
    - `tip`: name of the link whose frame is the tip; may be left out if of those that move only one carries
      no other.
    - `locked`: joints that do not move, such as a gripper's, with their positions, rad or m.
    - `gravity`: its acceleration in the base link's frame [3], m/s².
    - `armature`: inertia of the rotors, seen from the joints: one number, one for each joint that moves, or by joint
      name with 0 for the others, kg m² or kg. URDF has no place for it.
    - `packages`: where `package://NAME/...` is: folders by name, or folders in which packages are. The folders around
      the file are tried by themselves.
    - `meshes`: whether every mesh must be there. None is read: nothing of the motion depends on them.
    - `limits`: whether to read limits of positions, velocity and effort. Without them all are infinite.

    Raises DefinitionError, naming link or joint, if the file is not one arm on a fixed base, or has a value that is
    missing, misspelled or cannot be.
    """
    given = read(source, "robot", "from_mjcf reads <mujoco>")
    with located(str(given.path or "")):
        tree = tree_of(given.root)
        if not tree.joints:
            raise DefinitionError("the robot has no <joint>")
        if meshes:
            _require_meshes(tree, given.folder, packages)
        held = dict(locked or {})
        _refuse_mimics(tree, held)
        joints = _joints(tree, limits, _armatures(tree, held, armature))
        end = tip if tip is not None else _only_leaf(tree)
        if end == tree.root:
            raise DefinitionError(f"`tip` names link `{end}`, which is the base")
        return assemble(joints, tip=end, locked=held, gravity=gravity, name=given.root.get("name") or "robot")


def _require_meshes(tree: Tree, folder: Path, packages: Packages) -> None:
    for name, link in tree.links.items():
        for mesh in link.iter("mesh"):
            path = mesh.get("filename", "").strip()
            if not path:
                raise DefinitionError(f"a <mesh> of link `{name}` has no filename")
            require_mesh(f"link `{name}`", path, folder, packages)


def _refuse_mimics(tree: Tree, locked: Mapping[str, float]) -> None:
    """Every joint of an arm moves by itself, so that one which follows another must be held."""
    for name, joint in tree.joints.items():
        mimic = joint.find("mimic")
        if mimic is None or joint.get("type") == "fixed" or name in locked:
            continue
        other = mimic.get("joint", "")
        if other not in tree.joints:
            raise DefinitionError(
                f"joint `{name}` mimics joint `{other}`, which there is not; {nearest(other, tree.joints)}"
            )
        multiplier, offset = number(mimic, "multiplier"), number(mimic, "offset")
        position = (1.0 if multiplier is None else multiplier) * locked.get(other, 0.0) + (offset or 0.0)
        held = {other: locked.get(other, 0.0), name: position}
        raise DefinitionError(
            f"joint `{name}` mimics joint `{other}`; joints that are coupled must be held: locked={held}"
        )


def _armatures(tree: Tree, locked: Mapping[str, float], given: Armature) -> dict[str, float]:
    moving = [name for name in tree.order if tree.joints[name].get("type") != "fixed" and name not in locked]
    if isinstance(given, Mapping):
        for name in given:
            if name not in moving:
                raise DefinitionError(f"`armature` names joint `{name}`, which does not move; {nearest(name, moving)}")
        return {name: float(value) for name, value in given.items()}
    values = known(as_array(given))
    if values.shape not in ((), (len(moving),)):
        raise DefinitionError(
            f"`armature` must be one number, or one for each of the {len(moving)} joints that move, "
            f"{', '.join(moving)}; got shape {list(values.shape)}"
        )
    return dict(zip(moving, np.broadcast_to(values, len(moving)).tolist(), strict=True))


def _only_leaf(tree: Tree) -> str:
    leaves = [link for link in tree.leaves if link not in tree.standing]
    if not leaves:
        raise DefinitionError("the robot has no joint that moves")
    if len(leaves) > 1:
        raise DefinitionError(f"which link is the tip? say tip=NAME; {', '.join(leaves)} carry no other")
    return leaves[0]


def _joints(tree: Tree, limited: bool, armatures: Mapping[str, float]) -> list[Joint]:
    numbers = {link: str(i) for i, link in enumerate(tree.links)}
    standing = tree.standing
    with reading():
        spec = mujoco().MjSpec.from_string(_skeleton(tree, numbers))
        joints = []
        for name in tree.order:
            link = tree.children[name]
            heavy = link not in standing
            joints.append(_joint(tree, name, spec.body(numbers[link]), heavy, limited, armatures))
    return joints


def _joint(tree: Tree, name: str, body: Any, heavy: bool, limited: bool, armatures: Mapping[str, float]) -> Joint:
    element = tree.joints[name]
    kind = element.get("type")
    values: dict[str, Any] = {}
    if kind != "fixed":
        moved = body.joints[0]
        values = {
            "axis": np.array(moved.axis),
            "viscous": float(np.ravel(moved.damping)[0]),
            "coulomb": float(moved.frictionloss),
            "armature": armatures.get(name, 0.0),
            **(limits_of(element) if limited else {}),
        }
    # What stands still with the base may have any mass, and often has one that cannot be.
    if heavy and body.explicitinertial:
        # Of an inertia that is 0 MuJoCo makes one that is not defined.
        xx, yy, zz, xy, xz, yz = np.nan_to_num(body.fullinertia)
        turned = matrix_of(body.iquat)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        values |= {"mass": float(body.mass), "center": np.array(body.ipos), "inertia": turned @ inertia @ turned.T}
    return Joint(
        name=name,
        kind="revolute" if kind == "continuous" else kind,  # type: ignore[arg-type]
        parent=tree.carriers.get(tree.parents[name]),
        link=tree.children[name],
        rotation=matrix_of(body.quat),
        translation=np.array(body.pos),
        **values,
    )


def _skeleton(tree: Tree, numbers: Mapping[str, str]) -> str:
    """The file with what makes the motion only, and numbers for names.

    So nothing that is of no account can be in MuJoCo's way, and no name means anything to it, as `world` would.
    """
    robot = ET.Element("robot", name="robot")
    for link, number_ in numbers.items():
        _copy_known(tree.links[link], ET.SubElement(robot, "link", name=number_))
    for i, name in enumerate(tree.order):
        joint = tree.joints[name]
        kept = ET.SubElement(robot, "joint", name=f"joint {i}", type=joint.get("type", ""))
        _copy_known(joint, kept)
        for end, link in (("parent", tree.parents[name]), ("child", tree.children[name])):
            element = kept.find(end)
            assert element is not None
            element.set("link", numbers[link])
    return ET.tostring(robot, encoding="unicode")


def _copy_known(element: ET.Element, to: ET.Element) -> None:
    to.extend(copy.deepcopy(child) for child in element if child.tag in CHILDREN[element.tag] and child.tag != "mimic")
