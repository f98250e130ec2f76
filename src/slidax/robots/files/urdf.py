"""An arm from a URDF file."""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, as_array, each_of, known, located, nearest

from ..articulated import Articulated
from ..assemble import assemble
from ..coupled import Coupled, couple
from ..joint import Joint
from .inertias import Feasible, Inertias
from .loader import mujoco, reading
from .meshes import Packages, require_mesh
from .notes import Notes
from .rotation import matrix_of
from .source import Source, read
from .urdf_mimic import Mimicry, Mimics, hold_massless, mimicry_of
from .urdf_tree import Tree, tree_of
from .urdf_values import CHILDREN, MOTION, NUMBERS, limits_of

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
    mimics: Mimics = "held",
    arguments: Mapping[str, str] | None = None,
) -> Articulated | Coupled:
    """Read an arm from a URDF file, by MuJoCo (`pip install 'slidax[robots]'`).

    A limit that is missing or 0 is infinite. Each assumption is a `DefinitionWarning` that names file, element and
    remedy.

    - `source`: path of the file, or its text. A file that ends in `.xacro` is expanded by xacrodoc.
    - `tip`: name of the link whose frame is the tip; optional if only one moving link carries no other.
    - `locked`: positions of joints that do not move, such as a gripper's, rad or m.
    - `gravity`: acceleration in the base link's frame [3], m/s².
    - `armature`: rotor inertia at the joints: one number, one per moving joint, or by joint name with 0 for the others,
      kg m² or kg. URDF has no element for it.
    - `packages`: folders for `package://NAME/...`: by name, or folders that contain packages. The folders around the
      file are searched as well.
    - `meshes`: True if every mesh must exist. None is read, since the motion does not depend on them.
    - `limits`: True to read limits of position, velocity and effort. Otherwise all are infinite.
    - `inertias`: treatment of an inertia that no rigid body can have, such as one with a principal moment greater than
      the sum of the others. "given" replaces it by the nearest possible one if no principal moment is negative and none
      changes by more than 1 % of the largest, and is an error otherwise; "nearest" replaces it always, "strict" never.
      A DefinitionWarning states the size of a replacement.
    - `mimics`: "held" holds a joint that follows another, unless it is between base and tip; "followed" lets each move
      with its leader.
    - `arguments`: values of a xacro file's `<xacro:arg>` by name.

    Raises DefinitionError, naming link or joint, if the file is not one arm on a fixed base, or has a value that is
    missing, misspelled or invalid.
    """
    file = read(source, "robot", "from_mjcf reads <mujoco>", arguments=arguments, packages=packages)
    notes = Notes()
    for prefix, tag in file.prefixed.items():
        notes.add(f"<{tag}> has a prefix that nothing declares: it is not read; write xmlns:{prefix} into <robot>")
    with located(str(file.path or "")):
        try:
            arm, name = _arm(file, tip, locked, gravity, armature, packages, meshes, limits, inertias, mimics, notes)
        except DefinitionError as error:
            raise notes.explain(error) from error
    notes.warn(str(file.path or name), 2)
    return arm


def _arm(
    file: Source,
    tip: str | None,
    locked: Mapping[str, float] | None,
    gravity: Sequence[float],
    armature: Armature,
    packages: Packages,
    meshes: bool,
    limits: bool,
    inertias: Inertias,
    mimics: Mimics,
    notes: Notes,
) -> tuple[Articulated | Coupled, str]:
    tree = tree_of(file.root, notes)
    if not tree.joints:
        raise DefinitionError("the robot has no <joint>")
    if meshes:
        _require_meshes(tree, file.folder, packages)
    end = tip if tip is not None else _only_leaf(tree)
    if end == tree.root:
        raise DefinitionError(f"`tip` names link `{end}`, which is the base")
    mimicry = mimicry_of(tree, end, locked or {}, mimics, notes)
    if isinstance(armature, Mapping) or not np.any(known(as_array(armature))):
        hold_massless(tree, end, mimicry, armature if isinstance(armature, Mapping) else (), notes)
    feasible = Feasible(inertias)
    moving = [name for name in tree.order if tree.moves(name) and name not in mimicry.held]
    by_joint = _limits(tree, moving, locked or {}, mimicry, notes) if limits else {}
    joints = _joints(tree, by_joint, _armatures(moving, mimicry, armature), feasible)
    name = file.root.get("name") or "robot"
    arm = assemble(joints, tip=end, locked=mimicry.held, gravity=gravity, name=name)
    feasible.add_to(notes)
    return (_coupled(arm, mimicry, notes) if mimicry.following else arm), name


def _coupled(arm: Articulated, mimicry: Mimicry, notes: Notes) -> Coupled:
    following = {
        name: (follower.leader, follower.ratio, follower.offset) for name, follower in mimicry.following.items()
    }
    coupled = couple(arm, following)
    for name, (leader, ratio, offset) in following.items():
        at, own = coupled.joint_names.index(leader), arm.joint_names.index(leader)
        both = float(coupled.limits.lower[at]), float(coupled.limits.upper[at])
        narrowed = both != (float(arm.limits.lower[own]), float(arm.limits.upper[own]))
        becomes = f", whose range becomes {both[0]:.6g} to {both[1]:.6g}" if narrowed else ""
        notes.add(
            f"{{}} follows joint `{leader}` at the ratio {ratio:g} and the offset {offset:g}{becomes}, and is no joint "
            f"of the arm by itself; locked={{'{name}': POSITION}} holds it",
            f"joint `{name}`",
        )
    return coupled


def _drop_ranges_apart(limits: dict[str, dict[str, float]], mimicry: Mimicry, notes: Notes) -> None:
    """Ignore a follower's range that has nothing in common with its leader's."""
    left = {follower.leader: _range(limits[follower.leader]) for follower in mimicry.following.values()}
    for name, follower in mimicry.following.items():
        first, last = sorted((end - follower.offset) / follower.ratio for end in _range(limits[name]))
        lower, upper = left[follower.leader]
        if max(lower, first) < min(upper, last):
            left[follower.leader] = max(lower, first), min(upper, last)
            continue
        limits[name] = {key: value for key, value in limits[name].items() if key not in ("lower", "upper")}
        notes.add(
            f"the range of {{}}, {first:g} to {last:g} at its leader `{follower.leader}`, has nothing in common with "
            f"that one's, {lower:g} to {upper:g}: it is not read; correct the <limit> of one of them",
            f"joint `{name}`",
        )


def _range(limits: Mapping[str, float]) -> tuple[float, float]:
    return limits.get("lower", -np.inf), limits.get("upper", np.inf)


def _limits(
    tree: Tree, moving: Sequence[str], locked: Mapping[str, float], mimicry: Mimicry, notes: Notes
) -> dict[str, dict[str, float]]:
    """Limits by joint: of moving joints, and of those that the user holds, as far as they are valid."""
    by_joint, missing = dict[str, dict[str, float]](), dict[str, list[str]]()
    for name in moving:
        by_joint[name], without = limits_of(tree.joints[name], notes)
        # A follower is driven by its leader, and needs no limits of its own.
        for limit in without if name not in mimicry.following else ():
            missing.setdefault(limit, []).append(name)
    for name in locked:
        if name in tree.joints and tree.moves(name):
            with contextlib.suppress(DefinitionError):
                by_joint[name] = limits_of(tree.joints[name])[0]
    _drop_ranges_apart(by_joint, mimicry, notes)
    if missing:
        listed = ", ".join(f"no limit of {limit} for {', '.join(names)}" for limit, names in missing.items())
        notes.add(f"the file gives {listed}, or 0 for it; it is taken as infinite")
    return by_joint


def _require_meshes(tree: Tree, folder: Path, packages: Packages) -> None:
    for name, link in tree.links.items():
        for mesh in link.iter("mesh"):
            path = mesh.get("filename", "").strip()
            if not path:
                raise DefinitionError(f"a <mesh> of link `{name}` has no filename")
            require_mesh(f"link `{name}`", path, folder, packages)


def _armatures(joints: Sequence[str], mimicry: Mimicry, armature: Armature) -> dict[str, float]:
    moving = [name for name in joints if name not in mimicry.following]
    if isinstance(armature, Mapping):
        for name in armature:
            if name not in joints:
                raise DefinitionError(f"`armature` names joint `{name}`, which does not move; {nearest(name, joints)}")
        return {name: float(value) for name, value in armature.items()}
    values = known(as_array(armature))
    if values.shape not in ((), (len(moving),)):
        raise DefinitionError(
            f"`armature` must be one number, or one for {each_of(len(moving), 'joint')} that move, "
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


def _joints(
    tree: Tree, limits: Mapping[str, dict[str, float]], armatures: Mapping[str, float], feasible: Feasible
) -> list[Joint]:
    numbers = {link: str(i) for i, link in enumerate(tree.links)}
    with reading():
        spec = mujoco().MjSpec.from_string(_skeleton(tree, numbers))
        return [
            _joint(tree, name, spec.body(numbers[tree.children[name]]), limits.get(name, {}), armatures, feasible)
            for name in tree.order
        ]


def _joint(
    tree: Tree, name: str, body: Any, limits: Mapping[str, float], armatures: Mapping[str, float], feasible: Feasible
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
            **limits,
        }
    # A link fixed to the base may have any inertia, and often has an impossible one.
    if link not in tree.standing and body.explicitinertial:
        # Of an inertia that is 0 MuJoCo makes one that is not defined.
        xx, yy, zz, xy, xz, yz = np.nan_to_num(body.fullinertia)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if body.mass > 0:
            inertia = feasible.of(inertia, f"link `{link}`", moves=kind != "fixed")
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
    """The file with only the elements of the motion, and numbers for names.

    Other elements cannot disturb MuJoCo then, and no name, such as `world`, has a meaning for it.
    """
    robot = ET.Element("robot", name="robot")
    for link, number_ in numbers.items():
        _copy_known(tree.links[link], ET.SubElement(robot, "link", name=number_))
    for i, name in enumerate(tree.order):
        joint = tree.joints[name]
        kept = ET.SubElement(robot, "joint", name=f"joint {i}", type=joint.get("type", ""))
        _copy_known(joint, kept)
        for end, link in (("parent", tree.parents[name]), ("child", tree.children[name])):
            kept.extend([ET.Element(end, link=numbers[link])])
    return ET.tostring(robot, encoding="unicode")


def _copy_known(element: ET.Element, to: ET.Element) -> None:
    still = element.tag == "joint" and element.get("type") == "fixed"
    for name in CHILDREN[element.tag]:
        child = element.find(name)
        if child is None or name in ("parent", "child", "limit", "mimic") or (still and name in MOTION):
            continue
        known = NUMBERS.get(name, {})
        kept = ET.SubElement(to, name, {key: value for key, value in child.attrib.items() if key in known})
        if name in CHILDREN:
            _copy_known(child, kept)
