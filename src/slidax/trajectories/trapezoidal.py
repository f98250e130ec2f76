"""Trapezoidal velocity profiles: as fast as the limits allow, from rest to rest."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.parts import DefinitionError, as_array, shown

from .motion_limits import limit
from .piecewise_polynomial import AbstractPiecewisePolynomial
from .waypoints import distinct_waypoints

SAME_KNOT = 1e-12
"""Knots of two joints that lie closer than this part of a segment are one."""


class Trapezoidal(AbstractPiecewisePolynomial):
    """From waypoint to waypoint in the shortest time within limits of velocity and acceleration, at rest at each.

    The slowest joint's velocity is a trapezoid over time, or a triangle if it does not reach its limit; its
    acceleration jumps between 0 and its limit. With a jerk limit the acceleration is a ramp and the velocity an
    S-curve. The other joints take the same time: all start and arrive together, on a straight line in joint space where
    that is not slower.

    `Trapezoidal.through(waypoints, velocity=..., acceleration=...)` makes it. `MinimumJerk.within` does not stop at its
    waypoints.
    """

    @staticmethod
    def through(
        waypoints: object,
        *,
        velocity: object,
        acceleration: object,
        jerk: object = math.inf,
        start: float = 0.0,
    ) -> Trapezoidal:
        """Return the motion through waypoints, computed by Ruckig (Berscheid and Kröger, 2021).

        - `waypoints`: positions [k n], rad or m, no two in a row the same.
        - `velocity`: limit, [n] or one number, rad/s or m/s; infinite for none.
        - `acceleration`: limit, [n] or one number, rad/s² or m/s², finite.
        - `jerk`: limit, [n] or one number, rad/s³ or m/s³; infinite for none.
        - `start`: time of the first waypoint [s].

        Raises DefinitionError for invalid waypoints, a limit that is not positive, or if ruckig is not installed.
        """
        name = "Trapezoidal"
        q = distinct_waypoints(name, waypoints)
        bounds = {
            field: limit(name, field, value, q.shape[1])
            for field, value in (("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk))
        }
        if not np.all(np.isfinite(bounds["acceleration"])):
            raise DefinitionError(f"`{name}.acceleration` must be finite, or the velocity would jump")
        times, pieces = [float(start)], []
        for here, there in pairwise(q):
            knots, coefficients = _segment(here, there, bounds)
            times.extend(times[-1] + knots[1:])
            pieces.append(coefficients)
        return Trapezoidal(times=as_array(times), coefficients=as_array(np.concatenate(pieces, axis=1)))


def _segment(
    here: NDArray[np.float64], there: NDArray[np.float64], bounds: dict[str, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A motion from rest to rest: its knots from 0 on, and its coefficients [4 pieces n]."""
    profiles = _profiles(here, there, bounds)
    ends = [np.cumsum([0.0, *profile.t]) for profile in profiles]
    duration = max(end[-1] for end in ends)
    every = np.sort(np.concatenate(ends))
    knots = every[np.concatenate([[True], np.diff(every) > SAME_KNOT * duration])]
    # The last knot is the end itself, also if another one lies just before it.
    knots[-1] = duration
    middles = (knots[:-1] + knots[1:]) / 2
    coefficients = np.empty((4, len(middles), len(here)))
    for joint, (profile, end) in enumerate(zip(profiles, ends, strict=True)):
        phase = np.clip(np.searchsorted(end, middles, side="right") - 1, 0, len(profile.t) - 1)
        j, a, v, p = (np.asarray(values)[phase] for values in (profile.j, profile.a, profile.v, profile.p))
        x = knots[:-1] - end[phase]
        coefficients[:, :, joint] = (
            j / 6,
            (a + j * x) / 2,
            v + (a + j * x / 2) * x,
            p + (v + (a / 2 + j * x / 6) * x) * x,
        )
    return knots, coefficients


def _profiles(here: NDArray[np.float64], there: NDArray[np.float64], bounds: dict[str, NDArray[np.float64]]) -> Any:
    """Phases of constant jerk per joint: durations, and jerk, acceleration, velocity and position at each."""
    try:
        import ruckig
    except ImportError:
        raise DefinitionError("`Trapezoidal.through` needs ruckig: pip install 'slidax[trajectories]'") from None
    joints = len(here)
    # No joint comes to this speed before it must brake, so that it is no limit; Ruckig wants a number.
    free = 2.0 * np.sqrt(bounds["acceleration"] * np.abs(there - here)) + 1.0
    question = ruckig.InputParameter(joints)
    question.current_position = here.tolist()
    question.target_position = there.tolist()
    question.max_velocity = np.minimum(bounds["velocity"], free).tolist()
    question.max_acceleration = bounds["acceleration"].tolist()
    question.max_jerk = bounds["jerk"].tolist()
    question.synchronization = ruckig.Synchronization.Phase
    answer = ruckig.Trajectory(joints)
    try:
        ruckig.Ruckig(joints).calculate(question, answer)
    except ruckig.RuckigError as error:
        reason = str(error).replace("[ruckig]", "").strip()
        raise DefinitionError(f"`Trapezoidal`: no motion from {shown(here)} to {shown(there)}: {reason}") from None
    return answer.profiles[0]
