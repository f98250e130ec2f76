"""Read an arm from a URDF file, with its mimic joints."""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from slidax.core.errors import DefinitionError, as_array, each_of, locate_errors, nearest_word, static_value

from ..articulated import Articulated
from ..assemble import assemble
from ..coupled import Coupled, couple
from ..joint import Joint
from .inertias import Inertias, RigidInertias
from .reading import Notes, Packages, matrix_of, mujoco, reading, require_mesh
from .source import RobotFile, read_robot_file
from .urdf_tree import CHILDREN, MOTION, NUMBERS, UrdfTree, limits_of, number, rotor_inertias, urdf_tree

Mimics = Literal["held", "followed"]

FOLLOWED = 'mimics="followed"'

MOST_NAMES = 3
"""Most followers that a warning lists by name."""


@dataclass(frozen=True)
class Following:
    """A joint that follows another: its position is `ratio` times the leader's, plus `offset` [rad or m]."""

    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True)
class Mimicry:
    """Joints of an arm that do not move, and joints that follow another joint, as by `<mimic>`.

    - `held`: constant positions of the joints that do not move, by name, rad or m; also of those that the user locks.
    - `following`: joints that follow another joint, by name.
    """

    held: dict[str, float]
    following: dict[str, Following]


class InvalidLeaderError(Exception):
    """A follower has no valid leader."""


def mimicry_of(tree: UrdfTree, tip: str, locked: Mapping[str, float], mimics: str, notes: Notes) -> Mimicry:
    """Decide which joints with `<mimic>` are held at a constant position, and which follow their leader.

    A follower is held if its independent leader is locked or fixed. If `mimics` is "held", a follower is also held if
    it is not on the path from base to tip, at its position for the leader's position nearest to 0. The leader is held
    there too, if neither it nor one of its followers is on this path.

    - `tip`: name of the link whose frame is the tip.
    - `locked`: positions of the joints that the user holds, by name, rad or m.
    - `mimics`: "held" as above, or "followed" to let each follower move with its leader if the leader moves.
    - `notes`: receives the held joints.

    Raises DefinitionError, naming the joint, if a joint on the path follows an unknown joint or itself. Elsewhere
    such a joint is held at its position nearest to 0.
    """
    if mimics not in get_args(Mimics):
        raise DefinitionError(f"`mimics` must be `held` or `followed`; got `{mimics}`")
    between = tree.path_to(tip)
    held, following = dict(locked), dict[str, Following]()
    for name in tree.order:
        joint = tree.joints[name]
        if joint.find("mimic") is None or not tree.moves(name) or name in locked:
            continue
        try:
            leader_motion = resolve_mimic(tree, name, locked)
        except InvalidLeaderError as error:
            position = position_near_zero(tree, name)
            if name in between:
                raise DefinitionError(
                    f"{error}; locked={{'{name}': {position:g}}} holds the joint, or remove its <mimic>"
                ) from None
            held[name] = position
            remedy = f"locked={{'{name}': POSITION}} holds it elsewhere"
            notes.add(f"{error}: {{}} is held at {position:g}; {remedy}", _j(name))
            continue
        if isinstance(leader_motion, float):
            held[name] = leader_motion
            leader = _leader(tree, name)
            notes.add(
                f"{{}} mimics joint `{leader}`, which does not move: it is held at {leader_motion:g}; "
                f"locked={{'{name}': POSITION}} holds it elsewhere",
                _j(name),
            )
        else:
            following[name] = leader_motion
    if mimics == "held":
        _hold(tree, tip, between, held, following, notes)
    return Mimicry(held, following)


def hold_massless(tree: UrdfTree, tip: str, mimicry: Mimicry, rotors: Iterable[str], notes: Notes) -> None:
    """Hold joints outside the path from base to tip that carry no mass: they do not influence the motion.

    - `mimicry`: receives the held joints.
    - `rotors`: names of joints with rotor inertia, which move without a mass.
    """
    between = tree.path_to(tip)
    if not any(_mass(tree, name) for name in between):
        return
    carried: dict[str, float] = {}
    for name in reversed(tree.order):
        parent = tree.carriers.get(tree.parents[name])
        carried[name] = carried.get(name, 0.0) + _mass(tree, name)
        if parent is not None:
            carried[parent] = carried.get(parent, 0.0) + carried[name]
    coupled = {*mimicry.following, *(follower.leader for follower in mimicry.following.values())}
    for name in tree.order:
        if carried[name] == 0.0 and tree.moves(name) and name not in {*between, *coupled, *mimicry.held, *rotors}:
            mimicry.held[name] = position_near_zero(tree, name)
            notes.add(
                "{} moves no mass and is not between the base and the tip: it is held; give its link a mass", _j(name)
            )


def _mass(tree: UrdfTree, joint: str) -> float:
    return abs(number(tree.links[tree.children[joint]].find("inertial/mass"), "value") or 0.0)


def position_near_zero(tree: UrdfTree, name: str) -> float:
    """Return the position nearest to 0 within a joint's limits; 0 for a fixed joint."""
    try:
        limits = limits_of(tree.joints[name])[0] if tree.moves(name) else {}
    except DefinitionError:
        limits = {}
    return float(np.clip(0.0, limits.get("lower"), limits.get("upper")))


def _hold(
    tree: UrdfTree, tip: str, between: set[str], held: dict[str, float], following: dict[str, Following], notes: Notes
) -> None:
    groups: dict[str, list[str]] = {}
    for name, follow in following.items():
        groups.setdefault(follow.leader, []).append(name)
    for leader, followers in groups.items():
        outside = [name for name in followers if name not in between]
        apart = leader not in between and len(outside) == len(followers)
        if not outside:
            continue
        at = position_near_zero(tree, leader)
        positions = ({leader: at} if apart else {}) | {
            name: following[name].ratio * at + following[name].offset for name in outside
        }
        for name in outside:
            del following[name]
        held |= positions
        listed = ", ".join(f"'{name}': {position:.6g}" for name, position in positions.items())
        names = ", ".join(f"`{name}`" for name in outside[:MOST_NAMES])
        more = f" and {len(outside) - MOST_NAMES} more" if len(outside) > MOST_NAMES else ""
        notes.add(
            f"{{}} leads {names}{more}, which {'is' if len(outside) == 1 else 'are'} not between the base and the tip "
            f"`{tip}`: locked={{{listed}}} is assumed; give other positions by `locked`, or let them move together by "
            f"{FOLLOWED}",
            _j(leader),
        )


def resolve_mimic(tree: UrdfTree, name: str, locked: Mapping[str, float]) -> Following | float:
    """Resolve a chain of mimic joints: return its independent leader, ratio and offset.

    If that leader does not move, return the position of joint `name` [rad or m].

    Raises InvalidLeaderError if a joint of the chain follows an unknown joint or itself.
    """
    ratio, offset, at, passed = 1.0, 0.0, name, [name]
    while True:
        mimic = tree.joints[at].find("mimic")
        if at in locked:
            return ratio * locked[at] + offset
        if not tree.moves(at) or ratio == 0.0:
            return offset
        if mimic is None:
            return Following(at, ratio, offset)
        leader = _leader(tree, at)
        if leader not in tree.joints:
            raise InvalidLeaderError(
                f"joint `{at}` mimics joint `{leader}`, which does not exist; {nearest_word(leader, tree.joints)}"
            )
        multiplier = number(mimic, "multiplier")
        offset += ratio * (number(mimic, "offset") or 0.0)
        ratio *= 1.0 if multiplier is None else multiplier
        if leader in passed:
            raise InvalidLeaderError(f"joint `{at}` mimics joint `{leader}`, which follows it in turn")
        passed.append(leader)
        at = leader


def _leader(tree: UrdfTree, name: str) -> str:
    mimic = tree.joints[name].find("mimic")
    assert mimic is not None
    return mimic.get("joint", "").strip()


def _j(name: str) -> str:
    return f"joint `{name}`"


Armature = float | Sequence[float] | np.ndarray | Mapping[str, float]


def from_urdf(
    source: str | Path,
    *,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    armature: Armature | None = None,
    packages: Packages = (),
    meshes: bool = False,
    limits: bool = True,
    inertias: Inertias = "given",
    mimics: Mimics = "held",
    arguments: Mapping[str, str] | None = None,
) -> Articulated | Coupled:
    """Read an arm from a URDF file, by MuJoCo (`pip install 'slidax[robots]'`).

    The result is a `Coupled` arm if a joint moves with another. A velocity or effort limit is infinite if it is
    missing, 0 or -1, a position range if it is missing or from 0 to 0. Each assumption is a `DefinitionWarning` that
    names file, element and remedy.

    - `source`: path of the file, or its text. A file that ends in `.xacro` is expanded by xacrodoc.
    - `tip`: name of the link whose frame is the tip; optional if only one moving link carries no other link.
    - `locked`: positions of joints that do not move, such as a gripper's, rad or m.
    - `gravity`: acceleration in the base link's frame [3], m/s².
    - `armature`: rotor inertia at the joints: one number, one per moving joint that follows no other, or by joint name
      with 0 for the others, kg m² or kg; by default those of the file's transmissions, and 0 without any.
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
    file = read_robot_file(source, "robot", "from_mjcf reads <mujoco>", arguments=arguments, packages=packages)
    notes = Notes()
    for prefix, tag in file.prefixed.items():
        notes.add(f"<{tag}> has an undeclared prefix and is not read; declare xmlns:{prefix} in <robot>")
    with locate_errors(str(file.path or "")):
        try:
            arm, name = _arm(file, tip, locked, gravity, armature, packages, meshes, limits, inertias, mimics, notes)
        except DefinitionError as error:
            raise notes.explain(error) from error
    notes.warn(str(file.path or name), 2)
    return arm


def _arm(
    file: RobotFile,
    tip: str | None,
    locked: Mapping[str, float] | None,
    gravity: Sequence[float],
    armature: Armature | None,
    packages: Packages,
    meshes: bool,
    limits: bool,
    inertias: Inertias,
    mimics: Mimics,
    notes: Notes,
) -> tuple[Articulated | Coupled, str]:
    tree = urdf_tree(file.root, notes)
    if not tree.joints:
        raise DefinitionError("the robot has no <joint>")
    if meshes:
        _require_meshes(tree, file.folder, packages)
    end = tip if tip is not None else _only_leaf(tree)
    if end == tree.root:
        raise DefinitionError(f"`tip` names link `{end}`, which is the base")
    mimicry = mimicry_of(tree, end, locked or {}, mimics, notes)
    from_file = armature is None
    if armature is None:
        armature = _rotors(file, tree, notes)
    if isinstance(armature, Mapping) or not np.any(static_value(as_array(armature))):
        hold_massless(tree, end, mimicry, armature if isinstance(armature, Mapping) else (), notes)
    feasible = RigidInertias(inertias)
    moving = [name for name in tree.order if tree.moves(name) and name not in mimicry.held]
    if from_file and isinstance(armature, Mapping):
        armature = {name: value for name, value in armature.items() if name in moving}
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
            f"{{}} follows joint `{leader}` at the ratio {ratio:g} and the offset {offset:g}{becomes}, and is not a "
            f"joint of the arm by itself; locked={{'{name}': POSITION}} holds it",
            f"joint `{name}`",
        )
    return coupled


def _drop_ranges_apart(limits: dict[str, dict[str, float]], mimicry: Mimicry, notes: Notes) -> None:
    """Ignore a follower's range that does not overlap its leader's."""
    left = {follower.leader: _range(limits[follower.leader]) for follower in mimicry.following.values()}
    for name, follower in mimicry.following.items():
        first, last = sorted((end - follower.offset) / follower.ratio for end in _range(limits[name]))
        lower, upper = left[follower.leader]
        if max(lower, first) < min(upper, last):
            left[follower.leader] = max(lower, first), min(upper, last)
            continue
        limits[name] = {key: value for key, value in limits[name].items() if key not in ("lower", "upper")}
        notes.add(
            f"the range of {{}} is {first:g} to {last:g} in positions of its leader `{follower.leader}`, whose "
            f"range is {lower:g} to {upper:g}: they do not overlap, and the follower's is ignored; correct the <limit> "
            f"of one of them",
            f"joint `{name}`",
        )


def _range(limits: Mapping[str, float]) -> tuple[float, float]:
    return limits.get("lower", -np.inf), limits.get("upper", np.inf)


def _limits(
    tree: UrdfTree, moving: Sequence[str], locked: Mapping[str, float], mimicry: Mimicry, notes: Notes
) -> dict[str, dict[str, float]]:
    """Return the limits of moving joints, and the valid ones of joints that the user holds, by joint name."""
    by_joint, missing = dict[str, dict[str, float]](), dict[str, list[str]]()
    for name in moving:
        by_joint[name], without = limits_of(tree.joints[name], notes)
        # A follower's leader drives it, so its own limits may be missing.
        for limit in without if name not in mimicry.following else ():
            missing.setdefault(limit, []).append(name)
    for name in locked:
        if name in tree.joints and tree.moves(name):
            with contextlib.suppress(DefinitionError):
                by_joint[name] = limits_of(tree.joints[name])[0]
    _drop_ranges_apart(by_joint, mimicry, notes)
    if missing:
        listed = ", ".join(f"no limit of {limit} for {', '.join(names)}" for limit, names in missing.items())
        notes.add(f"the file has {listed}, or a limit of 0; such limits are taken as infinite")
    return by_joint


def _require_meshes(tree: UrdfTree, folder: Path, packages: Packages) -> None:
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
                raise DefinitionError(
                    f"`armature` names `{name}`, which is no moving joint; {nearest_word(name, joints)}"
                )
        return {name: float(value) for name, value in armature.items()}
    values = static_value(as_array(armature))
    if values.shape not in ((), (len(moving),)):
        raise DefinitionError(
            f"`armature` must be one number, or one for {each_of(len(moving), 'moving joint')}, "
            f"{', '.join(moving)}; got shape {list(values.shape)}"
        )
    return dict(zip(moving, np.broadcast_to(values, len(moving)).tolist(), strict=True))


def _rotors(file: RobotFile, tree: UrdfTree, notes: Notes) -> dict[str, float]:
    """Return the rotor inertias of the file's transmissions at joints that move, by joint name."""
    rotors = rotor_inertias(file.root)
    for name in rotors:
        if name not in tree.joints:
            notes.add(
                f"a transmission with a rotor inertia has {{}}, which does not exist; "
                f"{nearest_word(name, tree.joints)}",
                _j(name),
            )
    return {name: value for name, value in rotors.items() if name in tree.joints and tree.moves(name)}


def _only_leaf(tree: UrdfTree) -> str:
    leaves = [link for link in tree.leaves if link not in tree.standing]
    if not leaves:
        raise DefinitionError("the robot has no joint that moves")
    if len(leaves) > 1:
        raise DefinitionError(f"the tip is ambiguous: give tip=NAME; {', '.join(leaves)} carry no other link")
    return leaves[0]


def _joints(
    tree: UrdfTree, limits: Mapping[str, dict[str, float]], armatures: Mapping[str, float], feasible: RigidInertias
) -> list[Joint]:
    numbers = {link: str(i) for i, link in enumerate(tree.links)}
    with reading():
        spec = mujoco().MjSpec.from_string(_skeleton(tree, numbers))
        return [
            _joint(tree, name, spec.body(numbers[tree.children[name]]), limits.get(name, {}), armatures, feasible)
            for name in tree.order
        ]


def _joint(
    tree: UrdfTree,
    name: str,
    body: Any,
    limits: Mapping[str, float],
    armatures: Mapping[str, float],
    feasible: RigidInertias,
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
        # MuJoCo turns an inertia of 0 into NaN.
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


def _skeleton(tree: UrdfTree, numbers: Mapping[str, str]) -> str:
    """Return the file with only the elements that define the motion, and numbers instead of names.

    MuJoCo then cannot fail on other elements, and cannot give a name such as `world` a special meaning.
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
