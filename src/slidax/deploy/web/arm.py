"""An arm as a page draws it: its joints' frames, and plain shapes around its bones."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from slidax.robots import AbstractRobot, Articulated, Coupled
from slidax.trajectories import AbstractTrajectory
from slidax.views import Skeleton, skeleton_of

LINK, JOINT, TIP = 0, 1, 2
"""Tones."""

THICK = 0.04
"""Radius of the base's bone, of the arm's reach; half of it at the tip."""

INSTANTS = 200
"""At which a motion is looked at."""

Mapping = dict[str, Any]


def arm_entry(
    robot: AbstractRobot, label: str, title: str, torque: Any, rate: Any, trajectory: AbstractTrajectory, t1: float
) -> Mapping:
    """The arm in a playground.

    - `robot`: the arm.
    - `label`, `title`: what it is called there.
    - `torque`, `rate`: limits of torque and torque rate [n]; not finite where there are none.
    - `trajectory`, `t1`: what it is to follow, and until when [s]: rods that slide are drawn as long as they go far.
    """
    bones = skeleton_of(robot)
    times = jnp.linspace(0.0, t1, INSTANTS)
    goes = np.max(np.abs(jax.vmap(trajectory.position)(times)), axis=0)
    kinematics = [
        {
            "name": name,
            "parent": parent,
            "origin": [*_plain(place), *_plain(_quaternion(turn))],
            "axis": [0.0, 0.0, 1.0],
            "type": "revolute" if revolute else "prismatic",
            "joint": joint,
        }
        for joint, (name, parent, revolute, turn, place) in enumerate(
            zip(bones.names, bones.parents, bones.revolute, bones.rotations, bones.translations, strict=True)
        )
    ]
    return {
        "id": label,
        "title": title,
        "joints": bones.joints,
        "kinematics": kinematics,
        "shapes": _shapes(bones, np.asarray(goes)),
        "tip": {"link": bones.tip_joint, "at": _plain(bones.tip_translation)},
        "up": _plain(bones.up),
        "limits": {"torque": _limit(torque, bones.joints), "rate": _limit(rate, bones.joints)},
        "joint_limits": _joint_limits(robot),
    }


def _shapes(bones: Skeleton, goes: np.ndarray) -> list[Mapping]:
    """A drum around each joint that turns, a rod for each that slides, a bone to each child, and a ball at the tip.

    - `bones`: of the arm.
    - `goes`: how far each joint goes [n].
    """
    radii = _radii(bones)
    found: list[Mapping] = []
    for joint, parent in enumerate(bones.parents):
        r = radii[joint + 1]
        found += _bone(parent, bones.translations[joint], radii[parent + 1])
        if bones.revolute[joint]:
            found.append(_shape(joint, "cylinder", [1.2 * r, 2.5 * r], np.zeros(3), np.eye(3), JOINT))
        else:
            place, turn = bones.translations[joint], bones.rotations[joint]
            found.append(_shape(parent, "cylinder", [1.3 * r, 3.0 * r], place, turn, JOINT))
            rod = 0.15 * bones.reach + float(goes[joint])
            found.append(_shape(joint, "capsule", [0.5 * r, rod], np.array([0, 0, -0.5 * rod]), np.eye(3), LINK))
    tip, end = bones.tip_joint, radii[bones.tip_joint + 1]
    found += _bone(tip, bones.tip_translation, 0.7 * end)
    found.append(_shape(tip, "sphere", [0.75 * end], bones.tip_translation, np.eye(3), TIP))
    base = radii[0]
    along = _towards(bones.up)
    return [_shape(-1, "cylinder", [1.8 * base, 0.8 * base], -0.4 * base * bones.up, along, JOINT), *found]


def _bone(link: int, end: np.ndarray, radius: float) -> list[Mapping]:
    length = float(np.linalg.norm(end))
    if length < 0.2 * radius:
        return []
    return [_shape(link, "capsule", [0.85 * radius, length], 0.5 * end, _towards(end / length), LINK)]


def _shape(link: int, kind: str, size: list[float], place: np.ndarray, turn: np.ndarray, tone: int) -> Mapping:
    at = [*_plain(place), *_plain(_quaternion(turn))]
    return {"link": link, "kind": kind, "size": _plain(np.asarray(size)), "at": at, "tone": tone}


def _radii(bones: Skeleton) -> np.ndarray:
    """Of each body [n+1], m."""
    far = np.zeros(bones.joints + 1)
    for joint, parent in enumerate(bones.parents):
        far[joint + 1] = far[parent + 1] + np.linalg.norm(bones.translations[joint])
    return THICK * bones.reach * (1.0 - 0.5 * np.minimum(far / bones.reach, 1.0))


def _towards(direction: np.ndarray) -> np.ndarray:
    """A rotation that brings z to a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)


def _quaternion(turn: np.ndarray) -> np.ndarray:
    """Of a rotation, w first: the eigenvector of Bar-Itzhack's matrix, exact where others divide by little."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    matrix = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = np.linalg.eigh(matrix)[1][:, -1]
    found = np.array([w, x, y, z])
    return found if w >= 0 else -found


def _plain(numbers: Any) -> list[float]:
    """Numbers to a tenth of a micrometre: a picture shows no more."""
    return [float(f"{value:.7g}") if abs(value) > 1e-9 else 0.0 for value in np.asarray(numbers, float).ravel()]


def _limit(values: Any, joints: int) -> list[float] | None:
    each = np.broadcast_to(np.asarray(values, float), (joints,))
    return each.tolist() if np.isfinite(each).all() else None


def _joint_limits(robot: AbstractRobot) -> Mapping | None:
    limits = robot.limits if isinstance(robot, Articulated | Coupled) else None
    if limits is None or not np.isfinite([limits.lower, limits.upper]).all():
        return None
    return {"lower": _plain(limits.lower), "upper": _plain(limits.upper)}
