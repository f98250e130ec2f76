"""Assemble an arm from joints: remove fixed joints, rotate frames so that each axis is z, check the inertia matrix."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Array

from slidax.core.errors import DefinitionError, as_array, nearest_word
from slidax.core.joint_names import joint_label

from .arm import JointLimits, Payload
from .articulated import Articulated
from .joint import Joint, require_rigid
from .rotations import rotation_about

POSTURES = 3
"""Number of random postures in which the inertia matrix is tested."""

LEAST = 1e-12
"""Least eigenvalue of a regular inertia matrix with its diagonal scaled to 1; rounding gives a singular one 1e-16."""


def require_regular_inertia(arm: Articulated) -> None:
    """Raise DefinitionError if the inertia matrix is singular in all tested postures.

    The message names a joint that can move without moving mass. The matrix is singular, for example, if two joints
    share an axis and no link between them has mass.
    """
    least, joint = 0.0, 0
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, arm.joints)):
        mass = _inertia_matrix(arm, q)
        scale = np.sqrt(np.maximum(np.diagonal(mass), 0.0))
        if np.all(scale > 0):
            values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
            least, joint = max(least, float(values[0])), int(np.argmax(np.abs(vectors[:, 0])))
        else:
            joint = int(np.argmin(scale))
    if least < LEAST:
        raise DefinitionError(
            f"the inertia matrix of {arm.name} is singular: {joint_label(arm.joint_names[joint])} can move without "
            "moving any mass, by itself or against others; give the links between them mass, or the joint an armature"
        )


def _inertia_matrix(arm: Articulated, q: np.ndarray) -> np.ndarray:
    """Return the inertia matrix in a posture [n n]: `Σ (m Jᵥᵀ Jᵥ + J_ωᵀ I J_ω)` over the links, plus the armature.

    Jᵥ and J_ω are the Jacobians of a link's centre of mass and of its rotation. In NumPy, since JAX would compile a
    program for each operation of a new arm.
    """
    rotations, translations = np.asarray(arm.rotations), np.asarray(arm.translations)
    centers, inertias, masses = np.asarray(arm.centers), np.asarray(arm.inertias), np.asarray(arm.masses)
    placed: list[tuple[np.ndarray, np.ndarray]] = []
    mass = np.diag(np.asarray(arm.armature))
    for i, parent in enumerate(arm.parents):
        before, at = placed[parent] if parent >= 0 else (np.eye(3), np.zeros(3))
        rotation, position = before @ rotations[i], at + before @ translations[i]
        if arm.joint_units[i] == "rad":
            c, s = math.cos(q[i]), math.sin(q[i])
            rotation = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        else:
            position = position + q[i] * rotation[:, 2]
        placed.append((rotation, position))
        center = position + rotation @ centers[i]
        linear, angular = np.zeros((3, arm.joints)), np.zeros((3, arm.joints))
        j = i
        while j >= 0:
            axis = placed[j][0][:, 2]
            if arm.joint_units[j] == "rad":
                angular[:, j], linear[:, j] = axis, np.cross(axis, center - placed[j][1])
            else:
                linear[:, j] = axis
            j = arm.parents[j]
        turned = rotation @ inertias[i] @ rotation.T
        mass = mass + masses[i] * linear.T @ linear + angular.T @ turned @ angular
    return mass


SMOOTHING = 0.01
"""Width of the smoothed sign change of a new arm's Coulomb friction, rad/s or m/s."""


@dataclasses.dataclass
class _MovingBody:
    """A moving joint with the total mass of everything fixed to its link, in the link's frame.

    - `inertia`: about the centre of mass.
    """

    joint: Joint
    mass: float
    center: np.ndarray
    inertia: np.ndarray


@dataclasses.dataclass(frozen=True)
class _LinkFrame:
    """A link's frame relative to the moving link that carries it; `carrier` is None for the base."""

    carrier: str | None
    rotation: np.ndarray
    translation: np.ndarray


def assemble(
    joints: Sequence[Joint],
    *,
    tip: str,
    locked: Mapping[str, float] | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    name: str = "robot",
) -> Articulated:
    """Build an arm from joints.

    Links behind a fixed or a locked joint become part of the link that carries them; links fixed to the base are
    dropped. The remaining joints keep their order, except that each comes after its parent.

    - `joints`: joints in any order.
    - `tip`: name of the link whose frame is the tip; fixed joints may carry it.
    - `locked`: positions of joints that do not move, rad or m.
    - `gravity`: acceleration in the base frame [3], m/s².

    Raises DefinitionError, naming joint or link, if the joints do not form a tree, a name is unknown, a locked position
    is outside its limits, no joint moves the tip, a joint moves no mass, or no rigid body has a link's inertia.
    """
    locked = dict(locked or {})
    ordered = _in_order(joints)
    _check_locked(locked, ordered)
    placed: dict[str | None, _LinkFrame] = {None: _LinkFrame(None, np.eye(3), np.zeros(3))}
    moved: dict[str, _MovingBody] = {}
    for joint in ordered:
        before = placed[joint.parent]
        rotation = before.rotation @ np.asarray(joint.rotation, float)
        translation = before.translation + before.rotation @ np.asarray(joint.translation, float)
        if joint.kind != "fixed" and joint.name not in locked:
            axes = _axes_with_z(np.asarray(joint.axis, float))
            moving = dataclasses.replace(
                joint, parent=before.carrier, rotation=rotation @ axes, translation=translation
            )
            moved[joint.name] = _MovingBody(moving, 0.0, np.zeros(3), np.zeros((3, 3)))
            # The link's own frame in the joint's new frame, whose z is the axis.
            here = _LinkFrame(joint.name, axes.T, np.zeros(3))
        else:
            rotation, translation = _lock(joint, locked.get(joint.name, 0.0), rotation, translation)
            here = _LinkFrame(before.carrier, rotation, translation)
        placed[joint.name] = here
        if here.carrier is not None:
            _add(moved[here.carrier], joint, here)
    if not moved:
        raise DefinitionError(f"{name} has no joint that moves")
    _check_masses(moved, name)
    arm = _arm(moved, _tip(tip, ordered, placed, name), gravity, name)
    require_regular_inertia(arm)
    return arm


def _in_order(joints: Sequence[Joint]) -> list[Joint]:
    """Sort joints so that each comes after its parent."""
    by_name: dict[str, Joint] = {}
    links: dict[str, str] = {}
    for joint in joints:
        if joint.name in by_name:
            raise DefinitionError(f"there are two joints named `{joint.name}`")
        if joint.link in links:
            raise DefinitionError(
                f"link `{joint.link}` is moved by two joints, `{links[joint.link]}` and `{joint.name}`"
            )
        by_name[joint.name] = joint
        links[joint.link] = joint.name
    for joint in joints:
        if joint.parent is not None and joint.parent not in by_name:
            raise DefinitionError(
                f"joint `{joint.name}` has the parent joint `{joint.parent}`, which does not exist; "
                f"{nearest_word(joint.parent, by_name)}"
            )
    ordered: list[Joint] = []
    done: set[str | None] = {None}
    left = list(joints)
    while left:
        placeable = next((joint for joint in left if joint.parent in done), None)
        if placeable is None:
            names = ", ".join(f"`{joint.name}`" for joint in left)
            raise DefinitionError(f"the joints {names} carry each other in a circle; an arm is a tree")
        left.remove(placeable)
        ordered.append(placeable)
        done.add(placeable.name)
    return ordered


def _check_locked(locked: Mapping[str, float], joints: Sequence[Joint]) -> None:
    by_name = {joint.name: joint for joint in joints if joint.kind != "fixed"}
    for name, position in locked.items():
        if name not in by_name:
            raise DefinitionError(f"`locked` names `{name}`, which is no moving joint; {nearest_word(name, by_name)}")
        joint = by_name[name]
        if not (math.isfinite(position) and joint.lower - 1e-9 <= position <= joint.upper + 1e-9):
            raise DefinitionError(
                f"`locked` holds joint `{name}` at {position:g}, which is outside its limits, "
                f"{joint.lower:g} to {joint.upper:g}"
            )


def _axes_with_z(axis: np.ndarray) -> np.ndarray:
    """Return a frame whose z is along an axis, as columns; the identity if that axis is z."""
    z = axis / np.linalg.norm(axis)
    if z[2] == 1.0:
        return np.eye(3)
    # Start from the coordinate axis farthest from z, which loses the fewest digits.
    first = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(first, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _lock(
    joint: Joint, position: float, rotation: np.ndarray, translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a link's frame behind a joint at a fixed position."""
    if joint.kind == "fixed":
        return rotation, translation
    axis = np.asarray(joint.axis, float) / np.linalg.norm(joint.axis)
    if joint.kind == "prismatic":
        return rotation, translation + rotation @ (position * axis)
    return rotation @ rotation_about(axis, position), translation


def _add(carrier: _MovingBody, joint: Joint, here: _LinkFrame) -> None:
    """Add a link's mass and inertia to the body that carries it."""
    center = here.translation + here.rotation @ np.asarray(joint.center, float)
    turned = here.rotation @ np.asarray(joint.inertia, float) @ here.rotation.T
    # Written so that the numbers of a single link remain exactly those of the file.
    total = carrier.mass + joint.mass
    share = joint.mass / total if total > 0 else 0.0
    between = center - carrier.center
    carrier.inertia += turned + carrier.mass * share * (between @ between * np.eye(3) - np.outer(between, between))
    carrier.center = carrier.center + share * between
    carrier.mass = total


def _check_masses(moved: Mapping[str, _MovingBody], name: str) -> None:
    """Require that each joint moves mass; a link between two joints may be massless if a later link has mass."""
    if moved and not any(body.mass > 0 or body.joint.armature > 0 for body in moved.values()):
        raise DefinitionError(
            f"no moving link of {name} has a mass, as in files that are only for drawing: use a file with masses and "
            "inertias, or add them to each link"
        )
    carried = {joint: body.mass for joint, body in moved.items()}
    for joint in reversed(list(moved)):
        parent = moved[joint].joint.parent
        if moved[joint].mass == 0 and not (carried[joint] > 0 or moved[joint].joint.armature > 0):
            raise DefinitionError(
                f"link `{moved[joint].joint.link}` of {name}, moved by joint `{joint}`, has no mass, nor has anything "
                f"that is fixed to it: give it mass and inertia, or lock the joint"
            )
        if parent is not None:
            carried[parent] += carried[joint]


def _tip(tip: str, joints: Sequence[Joint], placed: Mapping[str | None, _LinkFrame], name: str) -> _LinkFrame:
    by_link = {joint.link: joint.name for joint in joints}
    if tip not in by_link:
        raise DefinitionError(f"`tip` names link `{tip}`, which {name} does not have; {nearest_word(tip, by_link)}")
    frame = placed[by_link[tip]]
    if frame.carrier is None:
        raise DefinitionError(f"`tip` names link `{tip}` of {name}, which no joint moves")
    return frame


def _arm(moved: Mapping[str, _MovingBody], tip: _LinkFrame, gravity: Sequence[float], name: str) -> Articulated:
    names = list(moved)
    joints = [body.joint for body in moved.values()]
    inertias = []
    for body in moved.values():
        inertia = 0.5 * (body.inertia + body.inertia.T)
        if body.mass > 0:
            what = f"the inertia of link `{body.joint.link}`, with all that is fixed to it,"
            require_rigid(inertia, what, moves=True)
        inertias.append(inertia)

    def each(field: str) -> Array:
        return as_array([getattr(joint, field) for joint in joints])

    assert tip.carrier is not None
    return Articulated(
        rotations=as_array(np.stack([joint.rotation for joint in joints])),
        translations=as_array(np.stack([joint.translation for joint in joints])),
        masses=as_array([body.mass for body in moved.values()]),
        centers=as_array(np.stack([body.center for body in moved.values()])),
        inertias=as_array(np.stack(inertias)),
        armature=each("armature"),
        viscous=each("viscous"),
        coulomb=each("coulomb"),
        smoothing=as_array(SMOOTHING),
        gravity_vector=as_array(gravity),
        tip_rotation=as_array(tip.rotation),
        tip_translation=as_array(tip.translation),
        payload=Payload(),
        limits=JointLimits(
            lower=each("lower"),
            upper=each("upper"),
            velocity=each("velocity"),
            torque=each("torque"),
            torque_rate=each("torque_rate"),
        ),
        name=name,
        joint_names=tuple(names),
        link_names=tuple(joint.link for joint in joints),
        parents=tuple(-1 if joint.parent is None else names.index(joint.parent) for joint in joints),
        tip_joint=names.index(tip.carrier),
        joint_units=tuple("rad" if joint.kind == "revolute" else "m" for joint in joints),
    )
