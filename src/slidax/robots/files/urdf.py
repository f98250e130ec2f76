"""An arm from a URDF file."""

from __future__ import annotations

import copy
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, DefinitionWarning, as_array, known, located, nearest

from ..articulated import Articulated
from ..assemble import assemble
from ..joint import Joint
from .inertias import Feasible, Inertias
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
    meshes: bool = False,
    limits: bool = True,
    inertias: Inertias = "given",
) -> Articulated:
    """An arm from a URDF file, read by MuJoCo (`pip install 'slidax[robots]'`).

    A limit that the file does not give, or gives as 0, is infinite; one warning, a `DefinitionWarning`, names the
    joints.

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
    - `inertias`: "given" refuses an inertia that no rigid body can have, such as one with a principal moment greater
      than the sum of the others; "nearest" takes the nearest that one can, and warns by how much it differs.

    Raises DefinitionError, naming link or joint, if the file is not one arm on a fixed base, or has a value that is
    missing, misspelled or invalid.
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
        feasible = Feasible(inertias)
        joints = _joints(tree, limits, _armatures(tree, held, armature), feasible)
        end = tip if tip is not None else _only_leaf(tree)
        if end == tree.root:
            raise DefinitionError(f"`tip` names link `{end}`, which is the base")
        name = given.root.get("name") or "robot"
        arm = assemble(joints, tip=end, locked=held, gravity=gravity, name=name)
    notes = [_not_given(tree, arm) if limits else "", feasible.note]
    if any(notes):
        said = "; ".join(note for note in notes if note)
        warnings.warn(f"{given.path or name}: {said}", DefinitionWarning, stacklevel=2)
    return arm


def _not_given(tree: Tree, arm: Articulated) -> str:
    """Which limits of the joints that move are not in the file."""
    missing: dict[str, list[str]] = {}
    for name in arm.joint_names:
        for limit in limits_of(tree.joints[name])[1]:
            missing.setdefault(limit, []).append(name)
    if not missing:
        return ""
    listed = ", ".join(f"no limit of {limit} for {', '.join(names)}" for limit, names in missing.items())
    return f"the file gives {listed}, or 0 for it; it is taken as infinite"


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
        first = locked.get(other, _within(tree.joints[other]))
        held = {other: first, name: (1.0 if multiplier is None else multiplier) * first + (offset or 0.0)}
        raise DefinitionError(
            f"joint `{name}` mimics joint `{other}`; joints that are coupled must be held: locked={held}"
        )


def _within(joint: ET.Element) -> float:
    """The position nearest to 0 that a joint can have."""
    found = {} if joint.get("type") == "fixed" else limits_of(joint)[0]
    return float(np.clip(0.0, found.get("lower"), found.get("upper")))


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


def _joints(tree: Tree, limited: bool, armatures: Mapping[str, float], feasible: Feasible) -> list[Joint]:
    numbers = {link: str(i) for i, link in enumerate(tree.links)}
    with reading():
        spec = mujoco().MjSpec.from_string(_skeleton(tree, numbers))
        return [
            _joint(tree, name, spec.body(numbers[tree.children[name]]), limited, armatures, feasible)
            for name in tree.order
        ]


def _joint(
    tree: Tree, name: str, body: Any, limited: bool, armatures: Mapping[str, float], feasible: Feasible
) -> Joint:
    element, link = tree.joints[name], tree.children[name]
    kind = element.get("type")
    values: dict[str, Any] = {}
    if kind != "fixed":
        moved = body.joints[0]
        values = {
            "axis": np.array(moved.axis),
            "viscous": float(np.ravel(moved.damping)[0]),
            "coulomb": float(moved.frictionloss),
            "armature": armatures.get(name, 0.0),
            **(limits_of(element)[0] if limited else {}),
        }
    # What stands still with the base may have any mass, and often has an impossible one.
    if link not in tree.standing and body.explicitinertial:
        # Of an inertia that is 0 MuJoCo makes one that is not defined.
        xx, yy, zz, xy, xz, yz = np.nan_to_num(body.fullinertia)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if body.mass > 0:
            inertia = feasible.of(inertia, f"link `{link}`", definite=kind != "fixed")
        turned = matrix_of(body.iquat)
        values |= {"mass": float(body.mass), "center": np.array(body.ipos), "inertia": turned @ inertia @ turned.T}
    return Joint(
        name=name,
        kind="revolute" if kind == "continuous" else kind,  # type: ignore[arg-type]
        parent=tree.carriers.get(tree.parents[name]),
        link=link,
        rotation=matrix_of(body.quat),
        translation=np.array(body.pos),
        **values,
    )


def _skeleton(tree: Tree, numbers: Mapping[str, str]) -> str:
    """The file with what makes the motion only, and numbers for names.

    So nothing that does not matter can be in MuJoCo's way, and no name means anything to it, as `world` would.
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
