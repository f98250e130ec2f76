"""Motion of a first scenario: a sinusoid about the home posture for each joint, within its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.robots import Articulated
from slidax.simulation.states import Numbers, states_of

from .loaded import with_tip_mass
from .posture import TIP_SHARE
from .ratings import Ratings

AMPLITUDE = {"rad": 0.4, "m": 0.08}
"""rad or m, reduced if the range is too small."""

FREQUENCY = (2.0, 2.4)
"""rad/s of the slowest and the fastest joint; no two are equal, so that all combinations of joint positions occur."""

RANGE_SHARE, VELOCITY_SHARE, TORQUE_SHARE = 0.5, 0.4, 0.65
"""Largest shares of the range around the home posture, and of the limits, that the motion uses."""

START = 0.2
"""rad: initial distance from the motion; a fifth of it in m."""


@dataclass(frozen=True)
class Motion:
    """Sinusoids about the home.

    - `amplitude`, `frequency`: [n], rad or m, rad/s.
    - `start`: positions at t = 0 [n].
    - `burden`: largest share of each torque limit that it needs, with 20 % of the arm's mass at the tip [n].
    """

    amplitude: Numbers
    frequency: Numbers
    start: Numbers
    burden: Numbers


def motion_about(arm: Articulated, ratings: Ratings, home: Numbers) -> Motion:
    """Return the motion about a home posture [n], slower and smaller until it is within the ratings."""
    units = arm.joint_units
    left = np.minimum(home - ratings.lower, ratings.upper - home)
    amplitude = np.minimum([AMPLITUDE[unit] for unit in units], RANGE_SHARE * left)
    frequency = np.linspace(*FREQUENCY, arm.joints) if arm.joints > 1 else np.array(FREQUENCY[:1])
    # Neighbours in the chain differ by more than a step.
    frequency = np.concatenate([frequency[::2], frequency[1::2]])
    slower = np.minimum(1.0, VELOCITY_SHARE * ratings.velocity / (amplitude * frequency))
    frequency = frequency * slower
    carrying = with_tip_mass(arm, TIP_SHARE)
    times = np.linspace(0.0, 12.0, 600)[:, None]
    held = np.abs(states_of(carrying, home[None]).bias[0]) / ratings.torque
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
