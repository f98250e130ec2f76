"""Poses: position and orientation of a tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError, shown
from slidax.robots import AbstractRobot

from .chain import chain_of
from .quaternion import matrix_of, quaternion_of
from .series import Array


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and orientation in the base frame.

    - `place`: [3], m.
    - `rotation`: axes of the tool's frame as columns [3 3].

    Raises DefinitionError unless the position has three finite numbers and the axes are orthonormal and right-handed.
    """

    place: Array
    rotation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", numbers("Pose.place", self.place, 3))
        rotation = np.asarray(self.rotation, float)
        square = rotation.shape == (3, 3) and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        if not (square and np.linalg.det(rotation) > 0):
            raise DefinitionError(f"`Pose.rotation` must have orthonormal axes, right-handed; got {shown(rotation)}")
        object.__setattr__(self, "rotation", rotation)

    @staticmethod
    def of(place: Sequence[float] | Array, quaternion: Sequence[float] | Array = (1.0, 0.0, 0.0, 0.0)) -> Pose:
        """Return a pose from a position [3], m, and a quaternion w, x, y, z of any length but zero [4].

        Raises DefinitionError for another number of entries, or entries that are not finite.
        """
        return Pose(numbers("Pose.place", place, 3), matrix_of(unit_quaternion("Pose.quaternion", quaternion)))

    @staticmethod
    def of_tip(robot: AbstractRobot, q: object) -> Pose:
        """Return the pose of a robot's tip at positions q [n], rad or m.

        Raises DefinitionError unless q has n finite numbers.
        """
        rotation, place = chain_of(robot).frame(numbers("q", q, robot.joints))
        return Pose(place, rotation)

    @property
    def quaternion(self) -> Array:
        """w, x, y, z of length 1, w >= 0 [4]."""
        return quaternion_of(self.rotation)


def numbers(owner: str, value: object, size: int) -> Array:
    """Return `size` finite numbers as an array.

    - `owner`: name of the field, for the message.

    Raises DefinitionError for anything else.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise DefinitionError(f"`{owner}` must be {size} finite numbers; got {shown(value)}")
    return array


def unit_quaternion(owner: str, value: object) -> Array:
    """Normalise a quaternion w, x, y, z [4].

    - `owner`: name of the field, for the message.

    Raises DefinitionError for another form, or a length of zero.
    """
    quaternion = numbers(owner, value, 4)
    size = float(np.linalg.norm(quaternion))
    if size < 1e-6:
        raise DefinitionError(f"`{owner}` must have a length > 0; got {shown(quaternion)}")
    return quaternion / size
