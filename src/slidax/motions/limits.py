"""Position, velocity and acceleration limits of a motion, and the check of a motion against them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, each_of, short_repr

from .trajectory import AbstractPiecewisePolynomial

ROUNDING = 1e-9
"""Relative tolerance of limits, for rounding."""


def limit(owner: str, name: str, value: object, joints: int, names: Sequence[str] = ()) -> NDArray[np.float64]:
    """Return a limit as an array of one number > 0 for each joint, [n]; infinity means no limit.

    - `owner`, `name`: class and field, for the message.
    - `value`: one number for all joints, or a list of n.
    - `joints`: n, the number of joints.
    - `names`: joint names, if they have any.

    Raises DefinitionError if a number is not positive, or if there are neither one nor n numbers.
    """
    numbers = one_per_joint(owner, name, value, joints)
    if not np.all(numbers > 0):
        joint = int(np.argmin(numbers > 0))
        raise DefinitionError(f"`{owner}.{name}` must be > 0; got {numbers[joint]:g} for {joint_label(joint, names)}")
    return numbers


def one_per_joint(owner: str, name: str, value: object, joints: int) -> NDArray[np.float64]:
    """Return an array of one number for each joint, [n], from one number for all joints or a list of n.

    - `owner`, `name`: class and field, for the message.
    - `joints`: n, the number of joints.

    Raises DefinitionError if a number is NaN, or if there are neither one nor n numbers.
    """
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise DefinitionError(
            f"`{owner}.{name}` must be a number or a list of numbers; got {short_repr(value)}"
        ) from None
    if numbers.shape not in ((), (joints,)):
        raise DefinitionError(
            f"`{owner}.{name}` must be one number or one for {each_of(joints, 'joint')}; "
            f"got shape {list(numbers.shape)}"
        )
    if np.any(np.isnan(numbers)):
        raise DefinitionError(f"`{owner}.{name}` must be numbers; one of them is NaN")
    return np.broadcast_to(numbers, (joints,))


def joint_label(joint: int, names: Sequence[str]) -> str:
    """Return a joint's name, or its number from 1, for messages."""
    return f"joint `{names[joint]}`" if names else f"joint {joint + 1}"


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a motion. Each is one number for all joints, or one for each; infinity means no limit.

    - `lower`, `upper`: positions, rad or m.
    - `velocity`: rad/s or m/s.
    - `acceleration`: rad/s² or m/s².
    """

    lower: object = -np.inf
    upper: object = np.inf
    velocity: object = np.inf
    acceleration: object = np.inf

    def require(
        self, motion: AbstractPiecewisePolynomial, source: str, names: Sequence[str], position_hint: str, rate_hint: str
    ) -> None:
        """Raise DefinitionError, with joint, value and time, if the motion exceeds a limit anywhere.

        - `source`: origin of the motion, for the message.
        - `names`: joint names, if they have any.
        - `position_hint`: likely cause of a position beyond its limit, for the message.
        - `rate_hint`: likely cause of a velocity or acceleration beyond its limit, for the message.
        """
        owner, joints = type(motion).__name__, motion.coefficients.shape[2]
        position = motion.extremes(0)
        lower = one_per_joint(owner, "lower", self.lower, joints)
        upper = one_per_joint(owner, "upper", self.upper, joints)
        slack = ROUNDING * np.maximum(1.0, position.size)
        for beyond, side, bound, value, when in (
            (position.least < lower - slack, "below", lower, position.least, position.when_least),
            (position.largest > upper + slack, "above", upper, position.largest, position.when_largest),
        ):
            if beyond.any():
                joint = int(np.argmax(beyond))
                raise DefinitionError(
                    f"{source}: {joint_label(joint, names)} would go to {value[joint]:.4g} at t = {when[joint]:.6g} s, "
                    f"{side} its limit of {bound[joint]:g}{position_hint}"
                )
        for order, name, units in ((1, "velocity", "rad/s (or m/s)"), (2, "acceleration", "rad/s² (or m/s²)")):
            bound = limit(owner, name, getattr(self, name), joints, names)
            extremes = motion.extremes(order)
            if np.any(extremes.size > bound * (1 + ROUNDING)):
                joint = int(np.argmax(extremes.size / bound))
                forward = extremes.largest[joint] >= -extremes.least[joint]
                when = (extremes.when_largest if forward else extremes.when_least)[joint]
                raise DefinitionError(
                    f"{source}: {joint_label(joint, names)} would need {extremes.size[joint]:.4g} {units} "
                    f"at t = {when:.6g} s, over its limit of {bound[joint]:g} for {name}{rate_hint}"
                )
