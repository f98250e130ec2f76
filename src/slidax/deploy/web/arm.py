"""Drawing of an arm on a page: its joints' frames, and plain shapes around its links."""

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
"""Radius at the base as a share of the arm's reach; half of it at the tip."""

INSTANTS = 200
"""Times at which a motion is evaluated."""


def arm_entry(
    robot: AbstractRobot, label: str, title: str, torque: Any, rate: Any, trajectory: AbstractTrajectory, t1: float
) -> dict[str, Any]:
    """The arm's entry in a playground.

    - `label`, `title`: its names there.
    - `torque`, `rate`: limits [n], N m or N, and per second; not finite where there are none.
    - `trajectory`, `t1`: its motion until `t1` [s], which sets the length of sliding rods.
    """
    bones = skeleton_of(robot)
    times = jnp.linspace(0.0, t1, INSTANTS)
    travel = np.max(np.abs(jax.vmap(trajectory.position)(times)), axis=0)
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
        "shapes": _shapes(bones, np.asarray(travel)),
        "tip": {"link": bones.tip_joint, "at": _plain(bones.tip_translation)},
        "up": _plain(bones.up),
        "limits": {"torque": _limit(torque, bones.joints), "rate": _limit(rate, bones.joints)},
        "joint_limits": _joint_limits(robot),
    }


def _shapes(bones: Skeleton, travel: np.ndarray) -> list[dict[str, Any]]:
    """A drum around each revolute joint, a rod for each prismatic one, a bone to each child, and a ball at the tip.

    - `travel`: largest displacement of each joint [n].
    """
    radii = _radii(bones)
    shapes: list[dict[str, Any]] = []
    for joint, parent in enumerate(bones.parents):
        r = radii[joint + 1]
        shapes += _bone(parent, bones.translations[joint], radii[parent + 1])
        if bones.revolute[joint]:
            shapes.append(_shape(joint, "cylinder", [1.2 * r, 2.5 * r], np.zeros(3), np.eye(3), JOINT))
        else:
            place, turn = bones.translations[joint], bones.rotations[joint]
            shapes.append(_shape(parent, "cylinder", [1.3 * r, 3.0 * r], place, turn, JOINT))
            rod = 0.15 * bones.reach + float(travel[joint])
            shapes.append(_shape(joint, "capsule", [0.5 * r, rod], np.array([0, 0, -0.5 * rod]), np.eye(3), LINK))
    tip, end = bones.tip_joint, radii[bones.tip_joint + 1]
    shapes += _bone(tip, bones.tip_translation, 0.7 * end)
    shapes.append(_shape(tip, "sphere", [0.75 * end], bones.tip_translation, np.eye(3), TIP))
    base = radii[0]
    along = _towards(bones.up)
    return [_shape(-1, "cylinder", [1.8 * base, 0.8 * base], -0.4 * base * bones.up, along, JOINT), *shapes]


def _bone(link: int, end: np.ndarray, radius: float) -> list[dict[str, Any]]:
    length = float(np.linalg.norm(end))
    if length < 0.2 * radius:
        return []
    return [_shape(link, "capsule", [0.85 * radius, length], 0.5 * end, _towards(end / length), LINK)]


def _shape(link: int, kind: str, size: list[float], place: np.ndarray, turn: np.ndarray, tone: int) -> dict[str, Any]:
    at = [*_plain(place), *_plain(_quaternion(turn))]
    return {"link": link, "kind": kind, "size": _plain(np.asarray(size)), "at": at, "tone": tone}


def _radii(bones: Skeleton) -> np.ndarray:
    """Radius of each body [n+1], m."""
    far = np.zeros(bones.joints + 1)
    for joint, parent in enumerate(bones.parents):
        far[joint + 1] = far[parent + 1] + np.linalg.norm(bones.translations[joint])
    return THICK * bones.reach * (1.0 - 0.5 * np.minimum(far / bones.reach, 1.0))


def _towards(direction: np.ndarray) -> np.ndarray:
    """A rotation that maps z to a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)


def _quaternion(turn: np.ndarray) -> np.ndarray:
    """Quaternion of a rotation, w first: eigenvector of Bar-Itzhack's matrix, which is accurate for all rotations."""
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
    return np.array([w, x, y, z]) * (1.0 if w >= 0 else -1.0)


def _plain(numbers: Any) -> list[float]:
    """Numbers to 7 digits, enough for a picture."""
    return [float(f"{value:.7g}") if abs(value) > 1e-9 else 0.0 for value in np.asarray(numbers, float).ravel()]


def _limit(values: Any, joints: int) -> list[float] | None:
    each = np.broadcast_to(np.asarray(values, float), (joints,))
    return each.tolist() if np.isfinite(each).all() else None


def _joint_limits(robot: AbstractRobot) -> dict[str, Any] | None:
    limits = robot.limits if isinstance(robot, Articulated | Coupled) else None
    if limits is None or not np.isfinite([limits.lower, limits.upper]).all():
        return None
    return {"lower": _plain(limits.lower), "upper": _plain(limits.upper)}
