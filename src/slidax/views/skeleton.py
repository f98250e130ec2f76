"""What a picture needs to know of an arm: the frames of its joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot, Articulated, Scara, TwoLink


@dataclass(frozen=True)
class Poses:
    """Where the bodies of an arm are at several times; body 0 is the base, body i + 1 is moved by joint i.

    - `rotations`: their axes as columns [k n+1 3 3].
    - `places`: of their origins [k n+1 3], m.
    """

    rotations: np.ndarray
    places: np.ndarray

    def points(self, body: int, offset: np.ndarray) -> np.ndarray:
        """A point of one body at all times [k 3], m.

        - `body`: its number.
        - `offset`: the point in the body's frame [3], m.
        """
        return self.places[:, body] + self.rotations[:, body] @ offset


@dataclass(frozen=True)
class Skeleton:
    """The frames of an arm's joints, which turn about or slide along their z axis, as in `Articulated`.

    - `parents`: number of the joint before each, -1 for the base.
    - `revolute`: whether each turns.
    - `rotations`, `translations`: of each frame in its parent's at position 0 [n 3 3], [n 3], m.
    - `tip_joint`, `tip_rotation`, `tip_translation`: the tip in the frame of the joint that carries it [3 3], [3], m.
    - `up`: against gravity, in the base frame [3].
    - `names`: of the joints.
    """

    parents: tuple[int, ...]
    revolute: tuple[bool, ...]
    rotations: np.ndarray
    translations: np.ndarray
    tip_joint: int
    tip_rotation: np.ndarray
    tip_translation: np.ndarray
    up: np.ndarray
    names: tuple[str, ...]

    @property
    def joints(self) -> int:
        """How many there are."""
        return len(self.parents)

    @property
    def chain(self) -> tuple[int, ...]:
        """The joints from the base to the tip."""
        chain = [self.tip_joint]
        while self.parents[chain[0]] >= 0:
            chain.insert(0, self.parents[chain[0]])
        return tuple(chain)

    @property
    def reach(self) -> float:
        """From the base along the arm to the tip, m."""
        steps = [*self.translations[list(self.chain)], self.tip_translation]
        return float(np.sum(np.linalg.norm(steps, axis=1)))

    def poses(self, q: np.ndarray) -> Poses:
        """Where the bodies are. It is in NumPy, since to compile `Articulated.frames` would take longer than the rest.

        - `q`: positions [k n], rad or m.
        """
        turns, slides = np.where(self.revolute, q, 0.0), np.where(self.revolute, 0.0, q)
        rotations = np.tile(np.eye(3), (len(q), self.joints + 1, 1, 1))
        places = np.zeros((len(q), self.joints + 1, 3))
        for joint, parent in enumerate(self.parents):
            carrier = rotations[:, parent + 1]
            turned = carrier @ self.rotations[joint]
            place = places[:, parent + 1] + carrier @ self.translations[joint]
            places[:, joint + 1] = place + turned[:, :, 2] * slides[:, joint, None]
            rotations[:, joint + 1] = turned @ _about_z(turns[:, joint])
        return Poses(rotations, places)

    def tips(self, poses: Poses) -> np.ndarray:
        """The places of the tip [k 3], m.

        - `poses`: what `poses` returned.
        """
        return poses.points(self.tip_joint + 1, self.tip_translation)


def _about_z(angles: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angles), np.sin(angles)
    turns = np.tile(np.eye(3), (len(angles), 1, 1))
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = cosine, -sine, sine, cosine
    return turns


def skeleton(robot: AbstractRobot, q: Any) -> np.ndarray:
    """The arm as points, from the base over its joints to the tip [m 3], m; joints that meet are one point.

    - `robot`: what `skeleton_of` knows.
    - `q`: positions [n], rad or m.
    """
    bones = skeleton_of(robot)
    poses = bones.poses(np.asarray(q)[None])
    joints = np.array(bones.chain) + 1
    points = np.concatenate([poses.places[0, :1], poses.places[0, joints], bones.tips(poses)])
    new = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9 * bones.reach
    return points[np.append(True, new)]


@singledispatch
def skeleton_of(robot: Any) -> Skeleton:
    """The skeleton of a robot; `skeleton_of.register` teaches it one of your own.

    - `robot`: an arm.

    Raises DefinitionError for a robot that it does not know.
    """
    raise DefinitionError(
        f"no picture of a `{type(robot).__name__}` is known; say where its joints are with "
        f"`@slidax.views.skeleton_of.register`, by a function from the robot to a `slidax.views.Skeleton`"
    )


@skeleton_of.register
def _(robot: Articulated) -> Skeleton:
    fall = np.asarray(robot.gravity_vector)
    size = float(np.linalg.norm(fall))
    return Skeleton(
        parents=robot.parents,
        revolute=tuple(unit == "rad" for unit in robot.joint_units),
        rotations=np.asarray(robot.rotations),
        translations=np.asarray(robot.translations),
        tip_joint=robot.tip_joint,
        tip_rotation=np.asarray(robot.tip_rotation),
        tip_translation=np.asarray(robot.tip_translation),
        up=-fall / size if size > 0 else np.array([0.0, 0.0, 1.0]),
        names=robot.joint_names,
    )


@skeleton_of.register
def _(robot: TwoLink) -> Skeleton:
    first, second = np.asarray(robot.lengths)
    along, up = np.eye(3)[:2]
    return _serial(first * along, tip=second * along, up=up)


@skeleton_of.register
def _(robot: Scara) -> Skeleton:
    first, second = np.asarray(robot.lengths)
    along, _, up = np.eye(3)
    arm = _serial(first * along, tip=second * along, up=up)
    return replace(
        arm,
        parents=(*arm.parents, 1),
        revolute=(*arm.revolute, False),
        # The slide's axis points down.
        rotations=np.append(arm.rotations, np.diag([1.0, -1.0, -1.0])[None], axis=0),
        translations=np.append(arm.translations, arm.tip_translation[None], axis=0),
        tip_joint=2,
        tip_translation=np.zeros(3),
        names=(*arm.names, "joint 3"),
    )


def _serial(elbow: np.ndarray, *, tip: np.ndarray, up: np.ndarray) -> Skeleton:
    """Two joints that turn about z, one behind the other."""
    return Skeleton(
        parents=(-1, 0),
        revolute=(True, True),
        rotations=np.tile(np.eye(3), (2, 1, 1)),
        translations=np.stack([np.zeros(3), elbow]),
        tip_joint=1,
        tip_rotation=np.eye(3),
        tip_translation=tip,
        up=up,
        names=("joint 1", "joint 2"),
    )
