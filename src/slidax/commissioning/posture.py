"""Home posture of an arm: inside its range, with low holding torques, and away from singularities."""

from __future__ import annotations

import numpy as np

from slidax.robots import Articulated
from slidax.simulation.states import Numbers, States, spread, states_of

from .loaded import with_tip_mass
from .ratings import Ratings

COUNT = 2000
"""Number of candidate postures, in addition to the middle and 0."""

TIP_SHARE = 0.2
"""Share of the moving mass at the tip."""

HELD = 0.5
"""Share of the torque limit for holding the posture above which it has a high cost."""


def home_of(arm: Articulated, ratings: Ratings) -> Numbers:
    """Return a home posture [n], rad or m.

    The best of 2000 postures spread over the inner half of the ranges, the middle and 0. The cost has the share of the
    torque limits that holds the arm with 20 % of its mass at the tip, the nearness to a singularity, the distance from
    0, and the depth of links below the base.
    """
    middle, half = 0.5 * (ratings.lower + ratings.upper), 0.5 * (ratings.upper - ratings.lower)
    wide = np.where(np.array(arm.joint_units) == "rad", np.minimum(half, 2.0), half)
    room = np.minimum(0.25 * half, 0.5)
    zero = np.clip(0.0, ratings.lower + room, ratings.upper - room)
    # The first joint of an arm on a table turns about the vertical and should stay near 0.
    near = np.where(np.abs(middle) < half, zero, middle)
    places = np.concatenate([[middle, zero], near + spread(-0.75 * wide, 0.75 * wide, COUNT)])
    places = np.clip(places, ratings.lower + room, ratings.upper - room)
    states = states_of(with_tip_mass(arm, TIP_SHARE), places)
    assert states.places is not None
    weight, points, tips = states.bias, states.places, states.tip
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
        + 0.5 * np.maximum(0.0, 1.0 - _dexterity(arm, states) / 0.1)
        + 3.0 * np.minimum(below / reach, 1.0)
        + 0.5 * away
    )
    return np.round(places[int(np.argmin(score))], 2)


def _dexterity(arm: Articulated, states: States) -> Numbers:
    """Ratio of smallest to largest singular value of the tip's Jacobian, with lengths relative to the reach."""
    assert states.axes is not None
    assert states.places is not None
    axes, points, tips = states.axes, states.places, states.tip
    turns = np.array(arm.joint_units) == "rad"
    arms = (tips[:, None] - points) / max(np.abs(tips[:, None] - points).max(), 1e-9)
    linear = np.where(turns[None, :, None], np.cross(axes, arms), axes)
    angular = np.where(turns[None, :, None], axes, 0.0)
    carries = np.array([_carries(arm, joint) for joint in range(arm.joints)])
    rows = [linear, angular] if arm.joints >= 6 else [linear]
    jacobian = np.concatenate(rows, axis=2) * carries[None, :, None]
    values = np.linalg.svd(jacobian, compute_uv=False)
    kept = min(arm.joints, values.shape[1], 6 if arm.joints >= 6 else 3)
    # No joint moves a tip that lies on all axes.
    return np.divide(values[:, kept - 1], values[:, 0], out=np.zeros(len(values)), where=values[:, 0] > 0.0)


def _carries(arm: Articulated, joint: int) -> bool:
    at = arm.tip_joint
    while at > joint:
        at = arm.parents[at]
    return at == joint
