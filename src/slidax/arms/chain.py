"""Forward kinematics: the chain of joints from the base to the tip, and poses of the tip, also called the tool.

Quantities along a motion are Taylor series in time or another parameter: lists of coefficients, from order 0 on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slidax.core.errors import DefinitionError, short_repr

from .arm import AbstractRobot
from .articulated import Articulated
from .coupled import Coupled
from .curves import Array, Series, constant, cosine_and_sine, product, scale_series, scale_vectors, sum_series
from .paper_arms import Scara, TwoLink
from .rotations import matrix_of, quaternion_of


class PlacedAxis(NamedTuple):
    """A joint's axis in the base frame: its unit direction and a point of the axis, Taylor series of vectors [... 3].

    - `joint`: index of the joint.
    - `revolute`: True for a revolute joint, False for a prismatic one.
    """

    joint: int
    revolute: bool
    direction: Series
    position: Series


class PlacedTool(NamedTuple):
    """The tool's frame in the base frame: axes x, y, z and position, Taylor series of vectors [... 3].

    - `axes`: the axes of the joints that move the tool.
    """

    x: Series
    y: Series
    z: Series
    position: Series
    axes: tuple[PlacedAxis, ...]


@dataclass(frozen=True, eq=False)
class KinematicChain:
    """The joints that move a robot's tip; each turns about, or slides along, the z axis of its frame.

    - `names`, `units`: names of the robot's n joints, and "rad" or "m" for each.
    - `joints`: indices of the c joints that move the tip, from the base on.
    - `rotations`, `translations`: frames of these c joints, each in the previous frame at position 0 [c 3 3], [c 3], m.
    - `revolute`: for each of these c joints, True if it is revolute.
    - `rotation`, `translation`: the tool's frame in the last joint's frame [3 3], [3], m.
    - `lower`, `upper`: position limits of all n joints, rad or m; infinite if there are none.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    joints: tuple[int, ...]
    rotations: Array
    translations: Array
    revolute: tuple[bool, ...]
    rotation: Array
    translation: Array
    lower: Array
    upper: Array

    @property
    def size(self) -> int:
        """The number of joints of the robot, n."""
        return len(self.names)

    def tool(self, q: Series) -> PlacedTool:
        """Return the tool's frame and the joint axes, both in the base frame, as Taylor series.

        - `q`: positions of all joints, a Taylor series of vectors [... n].
        """
        orders, shape = len(q), q[0].shape[:-1]
        columns = [constant(np.broadcast_to(axis, (*shape, 3)), orders) for axis in np.eye(3)]
        position = constant(np.zeros((*shape, 3)), orders)
        axes = []
        for joint, rotation, translation, revolute in zip(
            self.joints, self.rotations, self.translations, self.revolute, strict=True
        ):
            position = sum_series(position, _combine(columns, translation))
            x, y, z = (_combine(columns, column) for column in rotation.T)
            own = [None if coefficient is None else coefficient[..., joint] for coefficient in q]
            axes.append(PlacedAxis(joint, revolute, z, position))
            if revolute:
                c, s = cosine_and_sine(own)
                turned = sum_series(product(c, x, scale_vectors), product(s, y, scale_vectors))
                y = sum_series(product(c, y, scale_vectors), scale_series(product(s, x, scale_vectors), -1.0))
                x = turned
            else:
                position = sum_series(position, product(own, z, scale_vectors))
            columns = [x, y, z]
        position = sum_series(position, _combine(columns, self.translation))
        x, y, z = (_combine(columns, column) for column in self.rotation.T)
        return PlacedTool(x, y, z, position, tuple(axes))

    def frame(self, q: Array) -> tuple[Array, Array]:
        """Return the tool's axes, as columns, and its position in the base frame, [... 3 3] and [... 3], m.

        - `q`: positions of all joints [... n], rad or m.
        """
        tool = self.tool([np.asarray(q, float)])
        return np.stack([tool.x[0], tool.y[0], tool.z[0]], axis=-1), tool.position[0]


def kinematic_chain(robot: AbstractRobot) -> KinematicChain:
    """Return the chain of joints that move a robot's tip.

    Raises DefinitionError unless the robot is an articulated arm, a two-link arm or a SCARA.
    """
    if isinstance(robot, Articulated):
        joints: list[int] = []
        joint = robot.tip_joint
        while joint >= 0:
            joints.insert(0, joint)
            joint = robot.parents[joint]
        return KinematicChain(
            name=robot.name,
            names=robot.joint_names,
            units=robot.joint_units,
            joints=tuple(joints),
            rotations=np.asarray(robot.rotations)[joints],
            translations=np.asarray(robot.translations)[joints],
            revolute=tuple(robot.joint_units[joint] == "rad" for joint in joints),
            rotation=np.asarray(robot.tip_rotation),
            translation=np.asarray(robot.tip_translation),
            lower=np.asarray(robot.limits.lower),
            upper=np.asarray(robot.limits.upper),
        )
    if isinstance(robot, Coupled):
        raise DefinitionError(
            f"joint `{robot.followers[0]}` of {robot.name} follows another joint, so the arm is not a chain of "
            f"independent joints: give the motion in joint positions, or hold the follower by `locked`"
        )
    if not isinstance(robot, TwoLink | Scara):
        raise DefinitionError(
            f"the kinematics of a {type(robot).__name__} are not available as a chain of joints: build the arm by "
            "`slidax.arms.assemble`, or read it from a file"
        )
    first, second = np.asarray(robot.lengths)
    ahead = [[0.0, 0.0, 0.0], [first, 0.0, 0.0]]
    down = np.diag([1.0, -1.0, -1.0])
    slides = isinstance(robot, Scara)
    n = robot.joints
    return KinematicChain(
        name=type(robot).__name__,
        names=robot.joint_names,
        units=robot.joint_units,
        joints=tuple(range(n)),
        rotations=np.array([np.eye(3), np.eye(3), down]) if slides else np.array([np.eye(3)] * 2),
        translations=np.array([*ahead, [second, 0.0, 0.0]] if slides else ahead),
        revolute=(True, True, False)[:n],
        rotation=down if slides else np.eye(3),
        translation=np.zeros(3) if slides else np.array([second, 0.0, 0.0]),
        lower=np.full(n, -np.inf),
        upper=np.full(n, np.inf),
    )


def _combine(columns: list[Series], weights: Array) -> Series:
    """Return a linear combination of three Taylor series of vectors."""
    parts = [scale_series(column, weight) for column, weight in zip(columns, weights, strict=True) if weight != 0.0]
    return sum_series(*parts) if parts else scale_series(columns[0], 0.0)


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and orientation in the base frame.

    - `position`: [3], m.
    - `rotation`: axes of the tool's frame as columns [3 3].

    Raises DefinitionError unless the position has three finite numbers and the axes are orthonormal and right-handed.
    """

    position: Array
    rotation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", numbers("Pose.position", self.position, 3))
        rotation = np.asarray(self.rotation, float)
        square = rotation.shape == (3, 3) and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        if not (square and np.linalg.det(rotation) > 0):
            raise DefinitionError(
                f"`Pose.rotation` must have orthonormal axes, right-handed; got {short_repr(rotation)}"
            )
        object.__setattr__(self, "rotation", rotation)

    @staticmethod
    def of(position: Sequence[float] | Array, quaternion: Sequence[float] | Array = (1.0, 0.0, 0.0, 0.0)) -> Pose:
        """Return a pose from a position [3], m, and a quaternion w, x, y, z of any length but zero [4].

        Raises DefinitionError for another number of entries, or entries that are not finite.
        """
        return Pose(numbers("Pose.position", position, 3), matrix_of(unit_quaternion("Pose.quaternion", quaternion)))

    @staticmethod
    def of_tip(robot: AbstractRobot, q: object) -> Pose:
        """Return the pose of a robot's tip at positions q [n], rad or m.

        Raises DefinitionError unless q has n finite numbers.
        """
        rotation, position = kinematic_chain(robot).frame(numbers("q", q, robot.joints))
        return Pose(position, rotation)

    @property
    def quaternion(self) -> Array:
        """The orientation as a quaternion w, x, y, z of length 1, w >= 0 [4]."""
        return quaternion_of(self.rotation)


def numbers(owner: str, value: object, size: int) -> Array:
    """Return a value as an array of `size` finite numbers.

    - `owner`: name of the field, for the message.

    Raises DefinitionError for anything else.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise DefinitionError(f"`{owner}` must be {size} finite numbers; got {short_repr(value)}")
    return array


def unit_quaternion(owner: str, value: object) -> Array:
    """Return a quaternion w, x, y, z, normalised to length 1 [4].

    - `owner`: name of the field, for the message.

    Raises DefinitionError unless it has four finite numbers and a length > 0.
    """
    quaternion = numbers(owner, value, 4)
    size = float(np.linalg.norm(quaternion))
    if size < 1e-6:
        raise DefinitionError(f"`{owner}` must have a length > 0; got {short_repr(quaternion)}")
    return quaternion / size
