"""Ratings of an arm's drives: from its file, or from its weight if the file's values are implausible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slidax.robots import Articulated
from slidax.simulation.states import Numbers, spread, states_of

from .loaded import with_tip_mass

POSTURES = 256
"""Number of postures, spread evenly over the joints' ranges."""

SIZING_TIP_SHARE = 0.3
"""Share of the moving mass at the tip for which the drives are sized."""

ACCELERATION = 5.0
"""rad/s² or m/s²: acceleration of each joint alone for which its drive is sized."""

ROOM = 1.25
"""Torque of a drive over its requirement."""

SMALLEST = 0.15
"""Least torque of a drive over the largest of the same arm, as in real wrists."""

EQUAL, FAR = 5.0, 30.0
"""Ratio of limit to requirement above which a limit is a placeholder: one limit for all joints, or any limit."""

SPEED = {"rad": 2.0, "m": 0.5}
"""rad/s or m/s: velocity limit if the file has none."""

RANGE = {"rad": np.pi, "m": 0.5}
"""rad or m to both sides: range if the file has none."""


@dataclass(frozen=True)
class Ratings:
    """Ratings of the joints.

    - `torque`, `velocity`: [n], N m or N, rad/s or m/s.
    - `lower`, `upper`: ends of its range [n], rad or m.
    - `notes`: assumptions with their reasons, each a sentence.
    """

    torque: Numbers
    velocity: Numbers
    lower: Numbers
    upper: Numbers
    notes: tuple[str, ...]


def ratings_of(arm: Articulated) -> Ratings:
    """Return the ratings of an arm's joints from its description, with assumptions for missing or implausible values.

    A torque limit is replaced if it is missing, if it cannot hold half of the weight, if it exceeds 30 times the
    requirement, or if all joints have the same limit and it exceeds 5 times the requirement of one of them. The
    requirement of a joint is 1.25 times the sum of its weight in the worst of 256 postures, with 30 % of the moving
    mass at the tip, and the torque for 5 rad/s² of its own inertia. It is at least that of the joints after it, and at
    least 15 % of the largest.
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
    torque, torque_notes = _torques(arm, lower, upper)
    return Ratings(torque, velocity, lower, upper, (*notes, *torque_notes))


def _ends(lower: Numbers, upper: Numbers, reach: Numbers) -> tuple[Numbers, Numbers]:
    """Finite ends of the ranges: known ends stay, missing ones are `reach` from 0 or from the other end."""
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2.0 * reach, -reach))
    high = np.where(np.isfinite(upper), upper, low + 2.0 * reach)
    return low, high


def _torques(arm: Articulated, lower: Numbers, upper: Numbers) -> tuple[Numbers, list[str]]:
    limits, (needed, weight) = np.array(arm.limits.torque), _needed(arm, lower, upper)
    missing = ~np.isfinite(limits)
    ratio = np.where(missing, 0.0, limits / needed)
    one_for_all = bool(len(limits) > 2 and not missing.any() and np.ptp(limits) < 1e-9)
    far = (one_for_all and ratio.max() > EQUAL) | (ratio > FAR)
    far = np.broadcast_to(far, limits.shape)
    weak = ~missing & (limits < 0.5 * weight)
    if one_for_all and weak.any():
        weak = np.ones_like(missing)
    rounded = np.array([float(f"{value:.2g}") for value in needed])
    notes = []
    for which, why in (
        (missing, "no effort in the file, or 0"),
        (far & ~weak, _placeholder(limits, ratio, one_for_all)),
        (
            weak,
            f"{_list(limits[weak])} N m, which does not hold half of the arm's own weight, {_list(weight[weak])} N m",
        ),
    ):
        if which.any():
            notes.append(f"{_named(arm, which)}: {why}; by the arm's weight {_list(rounded[which])} N m is assumed")
    return np.where(missing | far | weak, np.where(far & ~weak, np.minimum(limits, rounded), rounded), limits), notes


def _placeholder(limits: Numbers, ratio: Numbers, one_for_all: bool) -> str:
    if one_for_all:
        return f"{limits[0]:g} N m on every joint, up to {ratio.max():.0f} times what this arm needs: a placeholder"
    far = ratio > FAR
    return (
        f"{_list(limits[far])} N m, up to {ratio.max():.0f} times what this arm needs: a placeholder"
        if far.any()
        else ""
    )


def _needed(arm: Articulated, lower: Numbers, upper: Numbers) -> tuple[Numbers, Numbers]:
    """Required torque of each drive, and the arm's own weight in the worst posture, [n] and [n], N m or N."""
    places = spread(lower, upper, POSTURES)
    own, carrying = states_of(arm, places), states_of(with_tip_mass(arm, SIZING_TIP_SHARE), places)
    weight, with_load = np.abs(own.bias).max(axis=0), np.abs(carrying.bias).max(axis=0)
    needed = ROOM * (with_load + ACCELERATION * np.diagonal(carrying.mass, axis1=1, axis2=2).max(axis=0))
    for unit in ("rad", "m"):
        same = np.array(arm.joint_units) == unit
        if same.any():
            least = SMALLEST * needed[same].max()
            needed[same] = np.maximum(np.maximum.accumulate(needed[same][::-1])[::-1], least)
    return needed, weight


def _named(arm: Articulated, which: NDArray[np.bool_]) -> str:
    names = [name for name, chosen in zip(arm.joint_names, which, strict=True) if chosen]
    return "all joints" if len(names) == arm.joints > 1 else ", ".join(names)


def _list(values: Numbers) -> str:
    shown = [f"{value:.3g}" for value in values]
    return shown[0] if len(set(shown)) == 1 else ", ".join(shown)
