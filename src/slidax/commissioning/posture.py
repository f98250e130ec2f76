"""Where an arm stands at home: inside its range, at ease, and away from singular postures."""

from __future__ import annotations

import numpy as np

from slidax.robots import Articulated
from slidax.simulation.states import Numbers, States, spread, states_of

from .loaded import loaded
from .ratings import Ratings

COUNT = 2000
"""Postures that are looked at, beside the middle and 0."""

TIP_SHARE = 0.2
"""Of the moving mass, carried at the tip."""

HELD = 0.5
"""Share of the torque that may be needed to stand there, before it counts as a burden."""


def home_of(arm: Articulated, ratings: Ratings) -> Numbers:
    """A posture to start from [n], rad or m.

    Of 2000 postures spread over the inner half of the ranges, the middle and 0, the best by: share of the torque
    limits that holds the arm with 20 % of its mass at the tip, how far it is from singular, and how far from the
    middle; parts below the base count against it.

    - `arm`: as it is described.
    - `ratings`: what its joints can do.
    """
    middle, half = 0.5 * (ratings.lower + ratings.upper), 0.5 * (ratings.upper - ratings.lower)
    wide = np.where(np.array(arm.joint_units) == "rad", np.minimum(half, 2.0), half)
    room = np.minimum(0.25 * half, 0.5)
    zero = np.clip(0.0, ratings.lower + room, ratings.upper - room)
    # The first joint of an arm on a table turns about the vertical: it stays where it is nearest to 0.
    near = np.where(np.abs(middle) < half, zero, middle)
    places = np.concatenate([[middle, zero], near + spread(-0.75 * wide, 0.75 * wide, COUNT)])
    places = np.clip(places, ratings.lower + room, ratings.upper - room)
    seen = states_of(loaded(arm, TIP_SHARE), places)
    assert seen.places is not None
    weight, points, tips = seen.bias, seen.places, seen.tip
    burden = (np.abs(weight) / ratings.torque).max(axis=1)
    up = -np.asarray(arm.gravity_vector)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0 else np.array([0.0, 0.0, 1.0])
    # The tip of a single joint may be on its axis.
    reach = max(np.abs(tips - points[:, 0]).max(), 1e-9)
    below = np.maximum(0.0, -np.minimum((points @ up).min(axis=1), tips @ up))
    away = (np.abs(places - zero) / wide).mean(axis=1)
    score = (
        np.maximum(burden - HELD, 0.0) * 10.0
        + burden
        + 0.5 * np.maximum(0.0, 1.0 - _dexterity(arm, seen) / 0.1)
        + 3.0 * np.minimum(below / reach, 1.0)
        + 0.5 * away
    )
    return np.round(places[int(np.argmin(score))], 2)


def _dexterity(arm: Articulated, seen: States) -> Numbers:
    """The least over the largest singular value of the tip's Jacobian, lengths by the reach."""
    assert seen.axes is not None
    assert seen.places is not None
    axes, points, tips = seen.axes, seen.places, seen.tip
    turns = np.array(arm.joint_units) == "rad"
    arms = (tips[:, None] - points) / max(np.abs(tips[:, None] - points).max(), 1e-9)
    linear = np.where(turns[None, :, None], np.cross(axes, arms), axes)
    angular = np.where(turns[None, :, None], axes, 0.0)
    carries = np.array([_carries(arm, joint) for joint in range(arm.joints)])
    rows = [linear, angular] if arm.joints >= 6 else [linear]
    jacobian = np.concatenate(rows, axis=2) * carries[None, :, None]
    values = np.linalg.svd(jacobian, compute_uv=False)
    kept = min(arm.joints, values.shape[1], 6 if arm.joints >= 6 else 3)
    # A tip on the axes of all joints is not moved at all.
    return np.divide(values[:, kept - 1], values[:, 0], out=np.zeros(len(values)), where=values[:, 0] > 0.0)


def _carries(arm: Articulated, joint: int) -> bool:
    at = arm.tip_joint
    while at > joint:
        at = arm.parents[at]
    return at == joint
