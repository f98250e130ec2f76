"""Joint frames of an arm, and their poses at the frames of a replay."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Any

import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.paper_arms import Scara, TwoLink
from slidax.core.errors import DefinitionError, count_noun
from slidax.core.joint_names import quote_names
from slidax.simulation.run import Log, Run

from ..figures.style import log_of


@dataclass(frozen=True)
class Poses:
    """Poses of the bodies at several times; body 0 is the base, joint i moves body i + 1.

    - `rotations`: axes as columns [k m+1 3 3].
    - `positions`: origins [k m+1 3], m.
    """

    rotations: np.ndarray
    positions: np.ndarray

    def points(self, body: int, offset: np.ndarray) -> np.ndarray:
        """Return a point of a `body` at all times [k 3], m; `offset` is the point in the body's frame [3], m."""
        return self.positions[:, body] + self.rotations[:, body] @ offset


@dataclass(frozen=True)
class Coupling:
    """Joints that follow others, as in `Coupled`: n joints are driven, and m joints move.

    - `leaders`: index of the driven joint that moves each joint [m].
    - `ratios`, `offsets`: each joint is at its ratio times its leader's position plus its offset [m].
    - `driven`: names of the driven joints.
    """

    leaders: tuple[int, ...]
    ratios: np.ndarray
    offsets: np.ndarray
    driven: tuple[str, ...]


@dataclass(frozen=True)
class Skeleton:
    """Joint frames of an arm with m joints. Joints turn about or slide along their z axis, as in `Articulated`.

    - `parents`: index of the previous joint, -1 for the base.
    - `rotations`, `translations`: pose of each frame in its parent's frame at joint position 0 [m 3 3], [m 3], m.
    - `tip_joint`: index of the joint that carries the tip.
    - `tip_rotation`, `tip_translation`: pose of the tip in this joint's frame [3 3], [3], m.
    - `revolute`, `names`: True for each revolute joint; names of the joints.
    - `up`: direction against gravity in the base frame [3].
    - `coupling`: joints that follow others; None if each joint has its drive.
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
    coupling: Coupling | None = None

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the joints with a drive, which are the joints of a run."""
        return self.names if self.coupling is None else self.coupling.driven

    @property
    def joints(self) -> int:
        """Number n of joints with a drive."""
        return len(self.driven)

    @property
    def bodies(self) -> int:
        """Number of bodies: the base, and one for each joint."""
        return len(self.parents) + 1

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Return the positions of all joints [k m] for those of the driven joints `q` [k n], rad or m."""
        if self.coupling is None:
            return q
        return self.coupling.ratios * q[:, self.coupling.leaders] + self.coupling.offsets

    @property
    def chain(self) -> tuple[int, ...]:
        """The joints from the base to the tip."""
        chain = [self.tip_joint]
        while self.parents[chain[0]] >= 0:
            chain.insert(0, self.parents[chain[0]])
        return tuple(chain)

    @property
    def reach(self) -> float:
        """Length along the arm from base to tip, m."""
        steps = [*self.translations[list(self.chain)], self.tip_translation]
        return float(np.sum(np.linalg.norm(steps, axis=1)))

    def poses(self, q: np.ndarray) -> Poses:
        """Return the bodies' poses at joint positions `q` [k n], rad or m. In NumPy: compiling would take longer."""
        moved = self.positions(q)
        angles, slides = np.where(self.revolute, moved, 0.0), np.where(self.revolute, 0.0, moved)
        rotations = np.tile(np.eye(3), (len(q), self.bodies, 1, 1))
        positions = np.zeros((len(q), self.bodies, 3))
        for joint, parent in enumerate(self.parents):
            carrier = rotations[:, parent + 1]
            turned = carrier @ self.rotations[joint]
            position = positions[:, parent + 1] + carrier @ self.translations[joint]
            positions[:, joint + 1] = position + turned[:, :, 2] * slides[:, joint, None]
            rotations[:, joint + 1] = turned @ _about_z(angles[:, joint])
        return Poses(rotations, positions)

    def tips(self, poses: Poses) -> np.ndarray:
        """Return the tip positions [k 3], m, for `poses` of the bodies."""
        return poses.points(self.tip_joint + 1, self.tip_translation)


def _about_z(angles: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angles), np.sin(angles)
    rotations = np.tile(np.eye(3), (len(angles), 1, 1))
    rotations[:, :2, :2] = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
    return rotations


def skeleton(robot: AbstractRobot, q: Any) -> np.ndarray:
    """Return the polyline of a `robot` at joint positions `q` [n]: base, joint origins and tip [points 3], m.

    Neighbours at the same position appear once.
    """
    bones = skeleton_of(robot)
    poses = bones.poses(np.asarray(q)[None])
    joints = np.array(bones.chain) + 1
    points = np.concatenate([poses.positions[0, :1], poses.positions[0, joints], bones.tips(poses)])
    new = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9 * bones.reach
    return points[np.append(True, new)]


@singledispatch
def skeleton_of(robot: Any) -> Skeleton:
    """Return the skeleton of a `robot`. Add a robot class of your own with `skeleton_of.register`.

    Raises DefinitionError for an unknown robot class.
    """
    raise DefinitionError(
        f"`{type(robot).__name__}` has no skeleton to draw: register a function from the robot to a "
        f"`slidax.report.replay.Skeleton` with `@slidax.report.replay.skeleton_of.register`"
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
def _(robot: Coupled) -> Skeleton:
    coupling = Coupling(robot.leaders, np.asarray(robot.ratios), np.asarray(robot.offsets), robot.joint_names)
    return replace(skeleton_of(robot.arm), coupling=coupling)


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
    """Return the skeleton of two revolute joints in series, which turn about z."""
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


LARGEST = 1e6
"""Larger positions or torques, in any unit, are not drawn."""


@dataclass(frozen=True)
class SampledRun:
    """A run at the frames of a replay, which are evenly spaced in time.

    - `t`: times of the frames [k], s.
    - `actual`, `desired`: poses of the true arm's bodies, and of the reference's.
    - `actual_tip`, `desired_tip`: tip positions [k 3], m.
    - `travel`: largest distance of each joint of the skeleton from 0 [m], rad or m.
    """

    t: np.ndarray
    actual: Poses
    desired: Poses
    actual_tip: np.ndarray
    desired_tip: np.ndarray
    travel: np.ndarray

    def frame(self, t: float) -> int:
        """Return the index of the frame nearest to time `t` [s]."""
        share = (t - self.t[0]) / (self.t[-1] - self.t[0])
        return int(np.clip(np.rint(share * (len(self.t) - 1)), 0, len(self.t) - 1))


def sample_run(run: Run, skeleton: Skeleton, rate: float, most: int) -> SampledRun:
    """Return the poses of true arm and reference at evenly spaced times, from the log by linear joint interpolation.

    - `run`: a run with a log.
    - `skeleton`: the skeleton of its robot.
    - `rate`: frames per second of simulated time, > 0.
    - `most`: largest number of frames; a longer run has fewer per second.

    Raises DefinitionError if the run has no log, or the robot has other joints.
    """
    log = log_of(run)
    q, desired = np.asarray(log.state.q), np.asarray(log.reference.q)
    if q.shape[1] != skeleton.joints:
        raise DefinitionError(
            f"the run has {count_noun(q.shape[1], 'joint')}, but this robot has {skeleton.joints}: give the run's robot"
        )
    names = skeleton.driven
    if tuple(names) != tuple(run.joint_names) and set(names) == set(run.joint_names):
        raise DefinitionError(
            f"the run's joints are {quote_names(run.joint_names)}, but this robot's are {quote_names(names)}: give the "
            "run's robot"
        )
    valid = valid_samples(log)
    t, q, desired = np.asarray(log.t)[valid], q[valid], desired[valid]
    if len(t) < 2:
        raise DefinitionError("this run ended before its second logged sample, so there is nothing to replay")
    frames = int(np.clip(np.ceil((t[-1] - t[0]) * rate - 1e-6) + 1, 2, most))
    times = np.linspace(t[0], t[-1], frames)
    actual, ideal = (skeleton.poses(_at(times, t, positions)) for positions in (q, desired))
    travel = np.abs(skeleton.positions(np.concatenate([q, desired]))).max(axis=0)
    return SampledRun(times, actual, ideal, skeleton.tips(actual), skeleton.tips(ideal), travel)


def valid_samples(log: Log) -> np.ndarray:
    """Return a mask of the samples to draw [k]: the `log` of a failed run may end in huge or non-finite values."""
    values = np.concatenate([np.asarray(part) for part in (log.state.q, log.reference.q, log.tau)], axis=1)
    with np.errstate(invalid="ignore"):
        return (np.abs(values) < LARGEST).all(axis=1)


def _at(times: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)
