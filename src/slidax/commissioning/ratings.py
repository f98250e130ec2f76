"""What the drives of an arm can do: by its file, or by its weight where the file cannot be meant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slidax.robots import Articulated
from slidax.simulation.states import Numbers, spread, states_of

from .loaded import loaded

POSTURES = 256
"""How many are looked at, spread evenly over the joints' ranges."""

SIZING_TIP_SHARE = 0.3
"""Of the moving mass, carried at the tip while the drives are sized."""

ACCELERATION = 5.0
"""Of each joint alone, for which its drive is sized, rad/s² or m/s²."""

ROOM = 1.25
"""A drive over what it must do."""

SMALLEST = 0.15
"""A drive over the largest of the same arm, at least: wrists are built so."""

EQUAL, FAR = 5.0, 30.0
"""A limit is none of this arm's if it is so many times what the drive must do: one for all joints, or any."""

SPEED = {"rad": 2.0, "m": 0.5}
"""Where the file gives no velocity, rad/s or m/s."""

RANGE = {"rad": np.pi, "m": 0.5}
"""To both sides where the file gives no ends, rad or m."""


@dataclass(frozen=True)
class Ratings:
    """What each joint can do.

    - `torque`, `velocity`: [n], N m or N, rad/s or m/s.
    - `lower`, `upper`: ends of its range [n], rad or m.
    - `notes`: what is not the file's, and why, each a sentence.
    """

    torque: Numbers
    velocity: Numbers
    lower: Numbers
    upper: Numbers
    notes: tuple[str, ...]


def ratings_of(arm: Articulated) -> Ratings:
    """What the joints can do by the arm's description, with assumptions where it says nothing that can be.

    A torque is assumed where none is given; where all joints have the same, and it is more than 5 times what one of
    them needs, or any has more than 30 times that; and where a joint could not hold half of its weight. What a joint
    needs: its weight in the worst of 256 postures with 30 % of the moving mass at the tip, and 5 rad/s² of its own
    inertia, times 1.25; no less than what those after it need, and no less than 15 % of the largest.

    - `arm`: as it is described.
    """
    limits, units = arm.limits, np.array(arm.joint_units)
    notes: list[str] = []
    lower, upper = np.array(limits.lower), np.array(limits.upper)
    endless = ~(np.isfinite(lower) & np.isfinite(upper))
    reach = np.array([RANGE[unit] for unit in units])
    lower, upper = _ends(lower, upper, reach)
    if endless.any():
        notes.append(f"{_named(arm, endless)}: no ends in the file; the motion stays within those below")
    velocity = np.array(limits.velocity)
    unknown = ~np.isfinite(velocity)
    velocity = np.where(unknown, [SPEED[unit] for unit in units], velocity)
    if unknown.any():
        notes.append(
            f"{_named(arm, unknown)}: no velocity in the file, or 0; {SPEED['rad']:g} rad/s or {SPEED['m']:g} m/s is "
            f"assumed"
        )
    elif len(velocity) > 2 and np.ptp(velocity) < 1e-9:
        either = " or ".join(f"{unit}/s" for unit in dict.fromkeys(units))
        notes.append(
            f"all joints: {velocity[0]:g} {either} on every joint, which may be a placeholder; the motion takes "
            f"40 % of it at most"
        )
    torque, said = _torques(arm, lower, upper)
    return Ratings(torque, velocity, lower, upper, (*notes, *said))


def _ends(lower: Numbers, upper: Numbers, reach: Numbers) -> tuple[Numbers, Numbers]:
    """Finite ends; of a range that is wider than a turn to both sides, the middle."""
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2.0 * reach, -reach))
    high = np.where(np.isfinite(upper), upper, low + 2.0 * reach)
    return low, high


def _torques(arm: Articulated, lower: Numbers, upper: Numbers) -> tuple[Numbers, list[str]]:
    given, (needed, weight) = np.array(arm.limits.torque), _needed(arm, lower, upper)
    missing = ~np.isfinite(given)
    ratio = np.where(missing, 0.0, given / needed)
    one_for_all = bool(len(given) > 2 and not missing.any() and np.ptp(given) < 1e-9)
    far = (one_for_all and ratio.max() > EQUAL) | (ratio > FAR)
    far = np.broadcast_to(far, given.shape)
    weak = ~missing & (given < 0.5 * weight)
    if one_for_all and weak.any():
        weak = np.ones_like(missing)
    rounded = np.array([float(f"{value:.2g}") for value in needed])
    notes = []
    for which, why in (
        (missing, "no effort in the file, or 0"),
        (far & ~weak, _placeholder(given, ratio, one_for_all)),
        (
            weak,
            f"{_list(given[weak])} N m, which does not hold half of the arm's own weight, {_list(weight[weak])} N m",
        ),
    ):
        if which.any():
            notes.append(f"{_named(arm, which)}: {why}; by the arm's weight {_list(rounded[which])} N m is assumed")
    return np.where(missing | far | weak, np.where(far & ~weak, np.minimum(given, rounded), rounded), given), notes


def _placeholder(given: Numbers, ratio: Numbers, one_for_all: bool) -> str:
    if one_for_all:
        return f"{given[0]:g} N m on every joint, up to {ratio.max():.0f} times what this arm needs: a placeholder"
    far = ratio > FAR
    return (
        f"{_list(given[far])} N m, up to {ratio.max():.0f} times what this arm needs: a placeholder"
        if far.any()
        else ""
    )


def _needed(arm: Articulated, lower: Numbers, upper: Numbers) -> tuple[Numbers, Numbers]:
    """What each drive must do, and the arm's own weight in the worst posture, [n] and [n], N m or N."""
    places = spread(lower, upper, POSTURES)
    own, carrying = states_of(arm, places), states_of(loaded(arm, SIZING_TIP_SHARE), places)
    weight, with_load = np.abs(own.bias).max(axis=0), np.abs(carrying.bias).max(axis=0)
    needed = ROOM * (with_load + ACCELERATION * np.diagonal(carrying.mass, axis1=1, axis2=2).max(axis=0))
    for unit in ("rad", "m"):
        same = np.array(arm.joint_units) == unit
        if same.any():
            least = SMALLEST * needed[same].max()
            needed[same] = np.maximum(np.maximum.accumulate(needed[same][::-1])[::-1], least)
    return needed, weight


def _named(arm: Articulated, which: NDArray[np.bool_]) -> str:
    names = [name for name, one in zip(arm.joint_names, which, strict=True) if one]
    return "all joints" if len(names) == arm.joints > 1 else ", ".join(names)


def _list(values: Numbers) -> str:
    shown = [f"{value:.3g}" for value in values]
    return shown[0] if len(set(shown)) == 1 else ", ".join(shown)
