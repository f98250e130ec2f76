"""Choices for a drafted scenario: drive ratings, home posture, motion."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, as_array, percent
from slidax.core.joint_names import joint_label
from slidax.simulation.states import Numbers, States, spread_in_box, states_of


def with_tip_mass(arm: Articulated, share: float) -> Articulated:
    """Return the arm with a heavier payload: `share` times the moving mass (the sum of the links' masses) is added."""
    mass = float(arm.payload.mass) + share * float(np.sum(np.asarray(arm.masses)))
    return eqx.tree_at(lambda arm: arm.payload.mass, arm, as_array(mass))


POSTURES = 256
"""Number of postures, spread evenly over the joints' ranges."""

SIZING_TIP_SHARE = 0.3
"""Share of the moving mass at the tip for which the drives are sized."""

ACCELERATION = 5.0
"""rad/s² or m/s²: acceleration of a single joint for which its drive is sized."""

RESERVE = 1.25
"""Factor from the required torque to the torque of a drive."""

SMALLEST = 0.15
"""Smallest drive torque relative to the arm's largest, as in real wrists."""

EQUAL, FAR = 5.0, 30.0
"""Ratios of limit to required torque, above which a limit is a placeholder: if all limits are equal, and otherwise."""

SPEED = {"rad": 2.0, "m": 0.5}
"""rad/s or m/s: assumed velocity limit if the file has none."""

RANGE = {"rad": np.pi, "m": 0.5}
"""rad or m to both sides: assumed half range of a joint without position limits in the file."""


@dataclass(frozen=True)
class Ratings:
    """Ratings of the joints.

    - `torque`, `velocity`: limits [n], N m or N, rad/s or m/s.
    - `torque_rate`: torque rate limits from the robot's file [n], N m/s or N/s; inf where it has none.
    - `lower`, `upper`: ends of the ranges [n], rad or m.
    - `notes`: assumptions with their reasons, each a sentence.
    """

    torque: Numbers
    torque_rate: Numbers
    velocity: Numbers
    lower: Numbers
    upper: Numbers
    notes: tuple[str, ...]


def ratings_of(arm: Articulated) -> Ratings:
    """Return the ratings of an arm's joints from its description, with assumptions for missing or implausible values.

    A torque limit is replaced by the required torque in four cases. In the last two the result is not above the limit.
    - It is missing.
    - It is below half of the joint's largest gravity torque. If all joints have the same limit, all are replaced.
    - It exceeds 30 times the required torque.
    - All joints, three or more, have the same limit, and it exceeds 5 times the required torque of one of them.

    The required torque of a joint is 1.25 times the sum of two torques. The first is the gravity torque in the worst of
    256 postures, with 30 % of the moving mass at the tip. The second accelerates the joint at 5 rad/s² or m/s². The
    required torque is at least that of later joints with the same unit, and 15 % of the largest with this unit.
    """
    limits, units = arm.limits, np.array(arm.joint_units)
    notes: list[str] = []
    lower, upper = np.array(limits.lower), np.array(limits.upper)
    endless = ~(np.isfinite(lower) & np.isfinite(upper))
    reach = np.array([RANGE[unit] for unit in units])
    lower, upper = _ends(lower, upper, reach)
    if endless.any():
        notes.append(
            f"{_named(arm, endless)}: no position limits in the file; the motion stays within an assumed range"
        )
    velocity = np.array(limits.velocity)
    unknown = ~np.isfinite(velocity)
    velocity = np.where(unknown, [SPEED[unit] for unit in units], velocity)
    if unknown.any():
        notes.append(
            f"{_named(arm, unknown)}: no velocity limit in the file, or 0; {SPEED['rad']:g} rad/s or "
            f"{SPEED['m']:g} m/s is assumed"
        )
    elif len(velocity) > 2 and np.ptp(velocity) < 1e-9:
        either = " or ".join(f"{unit}/s" for unit in dict.fromkeys(units))
        notes.append(
            f"all joints have the velocity limit {velocity[0]:g} {either}, which may be a placeholder; the motion uses "
            f"at most 40 % of it"
        )
    torque, torque_notes = _torques(arm, lower, upper)
    return Ratings(torque, np.array(limits.torque_rate), velocity, lower, upper, (*notes, *torque_notes))


def _ends(lower: Numbers, upper: Numbers, reach: Numbers) -> tuple[Numbers, Numbers]:
    """Return finite ends of the ranges: a missing end is `2 reach` from the other one; without either, ±`reach`."""
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
    why_weak = _too_weak(arm, limits, weight, weak, one_for_all)
    if one_for_all and weak.any():
        weak = np.ones_like(missing)
    rounded = np.array([float(f"{value:.2g}") for value in needed])
    assumed = np.where(far & ~weak, np.minimum(limits, rounded), rounded)
    notes = []
    for which, why in (
        (missing, "no effort limit in the file, or 0"),
        (far & ~weak, _placeholder(limits, ratio, one_for_all)),
        (weak, why_weak),
    ):
        if which.any():
            notes.append(f"{_named(arm, which)}: {why}; {_list(assumed[which])} N m is assumed from the arm's weight")
    return np.where(missing | far | weak, assumed, limits), notes


def _too_weak(arm: Articulated, limits: Numbers, weight: Numbers, weak: NDArray[np.bool_], one_for_all: bool) -> str:
    """Return why the limits of `weak` joints, or the common limit of all joints, are replaced; empty if none is."""
    if not weak.any():
        return ""
    limit = f"{limits[0]:g} N m for every joint" if one_for_all else f"a limit of {_list(limits[weak])} N m"
    carry = "carries" if weak.sum() == 1 else "carry"
    return f"{limit}, too small for half of the weight that {_named(arm, weak)} {carry}, {_list(weight[weak])} N m"


def _placeholder(limits: Numbers, ratio: Numbers, one_for_all: bool) -> str:
    if one_for_all:
        return f"{limits[0]:g} N m for every joint, up to {ratio.max():.0f} times the required torque: a placeholder"
    far = ratio > FAR
    return (
        f"{_list(limits[far])} N m, up to {ratio.max():.0f} times the required torque: a placeholder"
        if far.any()
        else ""
    )


def _needed(arm: Articulated, lower: Numbers, upper: Numbers) -> tuple[Numbers, Numbers]:
    """Required torque of each drive, and the largest gravity torque without a payload, [n] and [n], N m or N."""
    postures = spread_in_box(lower, upper, POSTURES)
    own, carrying = states_of(arm, postures), states_of(with_tip_mass(arm, SIZING_TIP_SHARE), postures)
    weight, with_load = np.abs(own.bias).max(axis=0), np.abs(carrying.bias).max(axis=0)
    needed = RESERVE * (with_load + ACCELERATION * np.diagonal(carrying.mass, axis1=1, axis2=2).max(axis=0))
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


COUNT = 2000
"""Number of candidate postures, in addition to the middle and 0."""

TIP_SHARE = 0.2
"""Default mass at the tip, as a share of the moving mass."""

HELD = 0.5
"""If holding a posture takes more than this share of a torque limit, the posture has a high cost."""


def tip_share(arm: Articulated, payload: float) -> float:
    """Return the mass at the tip for which motions are chosen, as a share of the moving mass: at least 0.2.

    - `payload`: mass that the arm carries [kg].
    """
    return max(TIP_SHARE, payload / float(np.sum(np.asarray(arm.masses))))


def home_of(arm: Articulated, ratings: Ratings, share: float = TIP_SHARE) -> Numbers:
    """Return a home posture [n], rad or m, for a payload of a `share` of the moving mass.

    It is the best of 2000 postures spread around 0, or around the middle of a range that excludes 0. The cost is
    lower with:
    - a smaller gravity torque relative to the torque limits, with this payload;
    - a larger distance from a singularity, and a smaller one from 0;
    - no links below the base.
    """
    middle, half = 0.5 * (ratings.lower + ratings.upper), 0.5 * (ratings.upper - ratings.lower)
    wide = np.where(np.array(arm.joint_units) == "rad", np.minimum(half, 2.0), half)
    room = np.minimum(0.25 * half, 0.5)
    zero = np.clip(0.0, ratings.lower + room, ratings.upper - room)
    # The first joint of an arm on a table rotates about the vertical and should stay near 0.
    near = np.where(np.abs(middle) < half, zero, middle)
    postures = np.concatenate([[middle, zero], near + spread_in_box(-0.75 * wide, 0.75 * wide, COUNT)])
    postures = np.clip(postures, ratings.lower + room, ratings.upper - room)
    states = states_of(with_tip_mass(arm, share), postures)
    assert states.positions is not None
    weight, points, tips = states.bias, states.positions, states.tip
    burden = (np.abs(weight) / ratings.torque).max(axis=1)
    up = -np.asarray(arm.gravity_vector)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0 else np.array([0.0, 0.0, 1.0])
    # The tip of a single joint may be on its axis.
    reach = max(np.abs(tips - points[:, 0]).max(), 1e-9)
    below = np.maximum(0.0, -np.minimum((points @ up).min(axis=1), tips @ up))
    away = (np.abs(postures - zero) / wide).mean(axis=1)
    score = (
        np.maximum(burden - HELD, 0.0) * 10.0
        + burden
        + 0.5 * np.maximum(0.0, 1.0 - _dexterity(arm, states) / 0.1)
        + 3.0 * np.minimum(below / reach, 1.0)
        + 0.5 * away
    )
    return np.round(postures[int(np.argmin(score))], 2)


def _dexterity(arm: Articulated, states: States) -> Numbers:
    """Ratio of smallest to largest singular value of the tip's Jacobian, with lengths relative to the reach."""
    assert states.axes is not None
    assert states.positions is not None
    axes, points, tips = states.axes, states.positions, states.tip
    revolute = np.array(arm.joint_units) == "rad"
    arms = (tips[:, None] - points) / max(np.abs(tips[:, None] - points).max(), 1e-9)
    linear = np.where(revolute[None, :, None], np.cross(axes, arms), axes)
    angular = np.where(revolute[None, :, None], axes, 0.0)
    carries = np.array([_carries(arm, joint) for joint in range(arm.joints)])
    rows = [linear, angular] if arm.joints >= 6 else [linear]
    jacobian = np.concatenate(rows, axis=2) * carries[None, :, None]
    values = np.linalg.svd(jacobian, compute_uv=False)
    kept = min(arm.joints, values.shape[1], 6 if arm.joints >= 6 else 3)
    # No joint moves a tip that lies on all axes.
    return np.divide(values[:, kept - 1], values[:, 0], out=np.zeros(len(values)), where=values[:, 0] > 0.0)


def _carries(arm: Articulated, joint: int) -> bool:
    carrier = arm.tip_joint
    while carrier > joint:
        carrier = arm.parents[carrier]
    return carrier == joint


AMPLITUDE = {"rad": 0.4, "m": 0.08}
"""rad or m: amplitude of the motion, reduced if the range is too small."""

FREQUENCY = (2.0, 2.4)
"""rad/s of the slowest and the fastest joint; no two joints are equal, so that all combinations of positions occur."""

RANGE_SHARE, VELOCITY_SHARE, TORQUE_SHARE = 0.5, 0.4, 0.65
"""Largest shares of the range around the home posture, and of the limits, that the motion uses."""

HOLDABLE = 0.8
"""Largest share of a torque limit that may hold a payload."""

START = 0.2
"""rad: initial distance from the motion; a fifth of this number in m for a prismatic joint."""


@dataclass(frozen=True)
class Motion:
    """Sinusoidal motion about the home posture.

    - `amplitude`, `frequency`: amplitude and frequency of each joint [n], rad or m, rad/s.
    - `start`: positions of the arm at t = 0, away from the motion [n], rad or m.
    - `burden`: largest torque of each joint along the motion, with the payload, as a share of its limit [n].
    """

    amplitude: Numbers
    frequency: Numbers
    start: Numbers
    burden: Numbers


def motion_about(arm: Articulated, ratings: Ratings, home: Numbers, share: float = TIP_SHARE) -> Motion:
    """Return a motion about a home posture, reduced in speed and amplitude until it is within the ratings.

    - `ratings`: from `ratings_of`.
    - `home`: the posture [n], rad or m.
    - `share`: payload as a share of the moving mass.

    Raises DefinitionError if holding a payload above 0.2 times the moving mass takes over 80 % of a torque limit.
    """
    units = arm.joint_units
    left = np.minimum(home - ratings.lower, ratings.upper - home)
    amplitude = np.minimum([AMPLITUDE[unit] for unit in units], RANGE_SHARE * left)
    frequency = np.linspace(*FREQUENCY, arm.joints) if arm.joints > 1 else np.array(FREQUENCY[:1])
    # Interleave, so that neighbouring joints have clearly different frequencies.
    frequency = np.concatenate([frequency[::2], frequency[1::2]])
    slower = np.minimum(1.0, VELOCITY_SHARE * ratings.velocity / (amplitude * frequency))
    frequency = frequency * slower
    carrying = with_tip_mass(arm, share)
    times = np.linspace(0.0, 12.0, 600)[:, None]
    held = np.abs(states_of(carrying, home[None]).bias[0]) / ratings.torque
    if share > TIP_SHARE and held.max() > HOLDABLE:
        joint = int(np.argmax(held))
        raise DefinitionError(
            f"the payload of {share * float(np.sum(np.asarray(arm.masses))):.3g} kg, at rest, takes "
            f"{percent(held[joint])} of the torque limit of {joint_label(arm.joint_names[joint])}; at most "
            f"{percent(HOLDABLE)} is allowed: choose a lighter payload, or an arm with larger torque limits"
        )
    allowed = np.maximum(TORQUE_SHARE, held.max() + 0.1)
    pace = 1.0
    for _ in range(12):
        w = pace * frequency
        angle = w * times
        states = states_of(carrying, home + amplitude * np.sin(angle), amplitude * w * np.cos(angle))
        burden = np.abs(states.torque(-amplitude * w**2 * np.sin(angle))).max(axis=0) / ratings.torque
        if burden.max() <= allowed:
            break
        pace *= 0.9
        amplitude = amplitude * 0.9
    away = START * np.array([1.0 if unit == "rad" else 0.2 for unit in units])
    sign = np.where(np.arange(arm.joints) % 2 == 0, 1.0, -1.0)
    away = np.minimum(away, 0.8 * left) * sign
    return Motion(np.round(amplitude, 2), np.round(pace * frequency, 2), np.round(home + away, 3), burden)
