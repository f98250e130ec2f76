"""Motions through waypoints: minimum jerk, trapezoidal velocity, and shortest times within limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, as_array, float_array, short_repr

from .limits import limit
from .splines import quintic_spline
from .trajectory import AbstractPiecewisePolynomial, derivative_coefficients, extremes

MOST_WAYPOINTS = 10_000
"""Most waypoints in one motion; longer motions are logs, and are read from files."""


FARTHEST = 1e9
"""Largest absolute position of a waypoint [rad or m]; its rounding error is about 1e-7."""


def waypoint_positions(owner: str, waypoints: object) -> NDArray[np.float64]:
    """Check k waypoints of n joints, and return them as an array of positions [k n].

    - `owner`: class of the motion, for the message.
    - `waypoints`: rows of positions, rad or m.

    Raises DefinitionError unless they are two or more rows of finite numbers of at most 1e9, one per joint; also for a
    list of more than 10 000 rows.
    """
    if isinstance(waypoints, Sequence) and len(waypoints) > MOST_WAYPOINTS:
        raise DefinitionError(f"`{owner}.waypoints` must be at most {MOST_WAYPOINTS} rows; got {len(waypoints)}")
    try:
        q = np.asarray(waypoints, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(f"`{owner}.waypoints` must be rows of numbers, all with one position per joint") from None
    if q.ndim != 2 or len(q) < 2 or q.shape[1] < 1:
        raise DefinitionError(
            f"`{owner}.waypoints` must be two or more rows with one position per joint; got shape {list(q.shape)}"
        )
    if not np.all(np.isfinite(q)):
        row, joint = np.argwhere(~np.isfinite(q))[0]
        raise DefinitionError(f"`{owner}.waypoints` must be finite; waypoint {row + 1} is not, for joint {joint + 1}")
    if np.any(np.abs(q) > FARTHEST):
        row, joint = np.argwhere(np.abs(q) > FARTHEST)[0]
        raise DefinitionError(
            f"`{owner}.waypoints` must be at most {FARTHEST:g} in size; got {q[row, joint]:g} in waypoint {row + 1} "
            f"for joint {joint + 1}"
        )
    return q


def distinct_waypoints(owner: str, waypoints: object) -> NDArray[np.float64]:
    """Check waypoints as `waypoint_positions` does, and also that consecutive waypoints differ.

    - `owner`: class of the motion, for the message.

    Returns the positions [k n]. Raises DefinitionError if two consecutive waypoints are equal, or as
    `waypoint_positions` does.
    """
    q = waypoint_positions(owner, waypoints)
    same = np.all(np.diff(q, axis=0) == 0, axis=1)
    if same.any():
        row = int(np.argmax(same)) + 1
        raise DefinitionError(
            f"`{owner}.waypoints` {row} and {row + 1} are the same, {short_repr(q[row])}: leave one of them out "
            "(for a pause, use `Tabulated.through` with velocities of 0 in both rows)"
        )
    return q


SAMPLES = 16
"""Samples per piece at which the search for the shortest times checks the limits.

The result of the search is then scaled so that the exact extremes satisfy the limits.
"""

SHORTEST = 0.02
"""Least duration of a piece in the search, relative to its initial duration."""

AT_REST = {1: 15 / 8, 2: 10 / math.sqrt(3), 3: 60.0}
"""Largest velocity (1), acceleration (2) and jerk (3) of the quintic from 0 to 1 in unit time, from rest to rest."""


def shortest_times(waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the shortest times of the waypoints, [k], from 0 on, for which the quintic spline keeps all limits.

    A piece is the motion between two waypoints. Sequential quadratic programming varies the ratios of the pieces'
    durations, starting from the shortest duration of each piece from rest to rest. All durations are then scaled so
    that the tightest limit is reached exactly: a factor c divides the derivative of order i by c^i. The search is
    local. If its result takes longer than the scaled initial durations, the function returns the times of the latter.

    - `waypoints`: positions [k n]; consecutive waypoints differ.
    - `limits`: limits of the joints [n] by order of the derivative, 1, 2, 3; infinite for none.
    """
    steps = np.abs(np.diff(waypoints, axis=0))
    least = np.stack([(AT_REST[order] * steps / bound) ** (1 / order) for order, bound in limits.items()])
    initial = _scaled_to_limits(np.asarray(least.max(axis=(0, 2)), dtype=float), waypoints, limits)
    if len(initial) == 1:
        return _times(initial)
    searched = _scaled_to_limits(_proportions(initial, waypoints, limits), waypoints, limits)
    best = min(initial, searched, key=np.sum)
    return _times(best)


def _times(durations: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(durations)])


def _scaled_to_limits(
    durations: NDArray[np.float64], waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the durations of the pieces, scaled by a common factor so that the tightest limit is reached exactly."""
    times = _times(durations)
    coefficients = quintic_spline(times, waypoints)
    ratios = [np.max(extremes(times, coefficients, i).size / bound) ** (1 / i) for i, bound in limits.items()]
    return durations * max(ratios)


def _peak(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the peak of sampled values [samples pieces n] for each piece and joint [pieces n].

    The peak is that of a parabola through the largest sample and its neighbours.
    """
    top = np.argmax(samples, axis=0)[None]
    before, at, after = (
        np.take_along_axis(samples, np.clip(top + step, 0, len(samples) - 1), axis=0)[0] for step in (-1, 0, 1)
    )
    bend = 2 * at - before - after
    inside = (top[0] > 0) & (top[0] < len(samples) - 1) & (bend > 0)
    rise: NDArray[np.float64] = np.where(inside, (after - before) ** 2, 0.0) / np.where(inside, 8 * bend, 1.0)
    return at + rise


def _proportions(
    initial: NDArray[np.float64], waypoints: NDArray[np.float64], limits: dict[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the durations of the pieces that have the least sum and keep the sampled derivatives within the limits."""
    from scipy.optimize import minimize

    z = np.linspace(0.0, 1.0, SAMPLES + 1)

    def margins(durations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the relative margins of all finite limits for each piece and joint: 1 at rest, 0 at the limit."""
        coefficients = quintic_spline(_times(durations), waypoints)
        parts = []
        for order, bound in limits.items():
            powers = derivative_coefficients(coefficients, order)
            degrees = np.arange(len(powers) - 1, -1, -1)
            basis = (z[:, None] * durations) ** degrees[:, None, None]
            peak = _peak(np.abs(np.einsum("dsp,dpn->spn", basis, powers)))
            # The root makes the peaks of all orders inversely proportional to a common factor of the durations.
            parts.append((1.0 - (peak / bound) ** (1 / order))[:, np.isfinite(bound)].ravel())
        return np.concatenate(parts)

    done = minimize(
        lambda share: float(np.sum(share * initial)) / float(np.sum(initial)),
        np.ones_like(initial),
        jac=lambda share: initial / float(np.sum(initial)),
        method="SLSQP",
        bounds=[(SHORTEST, None)] * len(initial),
        constraints={"type": "ineq", "fun": lambda share: margins(share * initial)},
        options={"maxiter": 200, "ftol": 1e-7},
    )
    return initial * (np.maximum(done.x, SHORTEST) if np.all(np.isfinite(done.x)) else 1.0)


MOST_TIMED_WAYPOINTS = 100
"""Most waypoints for `MinimumJerk.within`: memory grows with the square of their number, run time with the cube."""


class MinimumJerk(AbstractPiecewisePolynomial):
    """The curve through all waypoints at their times with the least `∫ ‖d³q_d/dt³‖² dt`, at rest at both ends.

    This curve is the quintic spline with four continuous derivatives and zero velocity and acceleration at both ends.
    If there are only two waypoints, it is `q_0 + (q_1 - q_0)(10 z³ - 15 z⁴ + 6 z⁵)`, `z = (t - t_0)/(t_1 - t_0)` (Flash
    and Hogan, 1985). The arm is at rest before the first waypoint and after the last.

    Construct one by `MinimumJerk.through(times, waypoints)`, or with the shortest times within limits by
    `MinimumJerk.within(waypoints, velocity=..., acceleration=...)`.
    """

    @staticmethod
    def through(times: object, waypoints: object) -> MinimumJerk:
        """Return the motion through waypoints at the specified times.

        - `times`: [k], s, strictly increasing, at least two.
        - `waypoints`: positions [k n], rad or m.

        Raises DefinitionError if the times do not increase or do not fit the waypoints, or for invalid waypoints.
        """
        t = float_array("MinimumJerk.times", times)
        if t.ndim != 1 or len(t) < 2 or not np.all(np.diff(t) > 0) or not np.all(np.isfinite(t)):
            raise DefinitionError(f"`MinimumJerk.times` must be two or more increasing times; got {short_repr(t)}")
        q = waypoint_positions("MinimumJerk", waypoints)
        if len(q) != len(t):
            raise DefinitionError(
                f"`MinimumJerk.waypoints` must be one row of joint positions for each of the {len(t)} times; "
                f"got {len(q)}"
            )
        if not np.all(np.diff(t) > 1e-9 * (t[-1] - t[0])):
            raise DefinitionError(
                "`MinimumJerk.times` lie too close together: each step must exceed 1e-9 of the whole duration; "
                f"got {short_repr(t)}"
            )
        return MinimumJerk(times=as_array(t), coefficients=as_array(quintic_spline(t, q)))

    @staticmethod
    def within(
        waypoints: object,
        *,
        velocity: object,
        acceleration: object,
        jerk: object = None,
        start: float = 0.0,
    ) -> MinimumJerk:
        """Return the motion through waypoints at the shortest times for which no joint exceeds a limit.

        The limits hold exactly, since they are compared with the extremes of the polynomials. One joint reaches one of
        its limits. For more than two waypoints a local search determines the times, which may not be the shortest.

        - `waypoints`: positions [k n], rad or m; consecutive waypoints differ.
        - `velocity`, `acceleration`, `jerk`: limits, [n] or one number, rad/s, rad/s², rad/s³ or m/s, m/s², m/s³;
          infinite, or for the jerk None, for no limit.
        - `start`: time of the first waypoint [s].

        Raises DefinitionError for invalid waypoints, more than 100 of them, a limit that is not positive, or a step in
        which no moving joint has a limit.
        """
        name = "MinimumJerk"
        q = distinct_waypoints(name, waypoints)
        if len(q) > MOST_TIMED_WAYPOINTS:
            raise DefinitionError(
                f"`{name}.within` finds the times of at most {MOST_TIMED_WAYPOINTS} waypoints; got {len(q)}; "
                f"pass times to `{name}.through`, or stop at each waypoint with `Trapezoidal.through`"
            )
        limits = {
            order: limit(name, field, value, q.shape[1])
            for order, field, value in ((1, "velocity", velocity), (2, "acceleration", acceleration), (3, "jerk", jerk))
            if value is not None
        }
        bounded = np.any([np.isfinite(bound) for bound in limits.values()], axis=0)
        unbounded = ~np.any((np.diff(q, axis=0) != 0) & bounded, axis=1)
        if unbounded.any():
            step = int(np.argmax(unbounded)) + 1
            raise DefinitionError(
                f"`{name}` needs a finite limit for a joint that moves from waypoint {step} to {step + 1}, "
                "or it could move in no time"
            )
        return MinimumJerk.through(shortest_times(q, limits) + start, q)


SAME_KNOT = 1e-12
"""Two knots become one if they are closer than this fraction of the segment's duration."""


class Trapezoidal(AbstractPiecewisePolynomial):
    """Motion from waypoint to waypoint in the shortest time within velocity and acceleration limits, at rest at each.

    The slowest joint's velocity is a trapezoid over time, or a triangle if it does not reach its limit. Its
    acceleration jumps between 0 and its limit. With a jerk limit the acceleration consists of ramps, and the velocity
    of S-curves. All joints start and arrive together, on a straight line in joint space if that is not slower.

    Construct one by `Trapezoidal.through(waypoints, velocity=..., acceleration=...)`. For a motion that does not stop
    at its waypoints, use `MinimumJerk.within`.
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

        - `waypoints`: positions [k n], rad or m; consecutive waypoints differ.
        - `velocity`: limit, [n] or one number, rad/s or m/s; infinite for none.
        - `acceleration`: limit, [n] or one number, rad/s² or m/s², finite.
        - `jerk`: limit, [n] or one number, rad/s³ or m/s³; infinite for none.
        - `start`: time of the first waypoint [s].

        Raises DefinitionError for invalid waypoints, for a limit that is not positive, for an infinite acceleration
        limit, or if ruckig is not installed.
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
        for first, last in pairwise(q):
            knots, coefficients = _segment(first, last, bounds)
            times.extend(times[-1] + knots[1:])
            pieces.append(coefficients)
        return Trapezoidal(times=as_array(times), coefficients=as_array(np.concatenate(pieces, axis=1)))


def _segment(
    first: NDArray[np.float64], last: NDArray[np.float64], bounds: dict[str, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a motion from rest to rest: its knots from 0 on, and its coefficients [4 pieces n]."""
    profiles = _profiles(first, last, bounds)
    ends = [np.cumsum([0.0, *profile.t]) for profile in profiles]
    duration = max(end[-1] for end in ends)
    every = np.sort(np.concatenate(ends))
    knots = every[np.concatenate([[True], np.diff(every) > SAME_KNOT * duration])]
    # The last knot is exactly the end, even if another knot is just before it.
    knots[-1] = duration
    middles = (knots[:-1] + knots[1:]) / 2
    coefficients = np.empty((4, len(middles), len(first)))
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


def _profiles(first: NDArray[np.float64], last: NDArray[np.float64], bounds: dict[str, NDArray[np.float64]]) -> Any:
    """Return Ruckig's phases of constant jerk per joint.

    Each joint has the phases' durations, their jerks, and acceleration, velocity and position at their start.
    """
    try:
        import ruckig
    except ImportError:
        raise DefinitionError("`Trapezoidal.through` needs ruckig: pip install 'slidax[trajectories]'") from None
    joints = len(first)
    # Ruckig needs a finite velocity limit. No joint reaches this one before it must brake.
    free = 2.0 * np.sqrt(bounds["acceleration"] * np.abs(last - first)) + 1.0
    problem = ruckig.InputParameter(joints)
    problem.current_position = first.tolist()
    problem.target_position = last.tolist()
    problem.max_velocity = np.minimum(bounds["velocity"], free).tolist()
    problem.max_acceleration = bounds["acceleration"].tolist()
    problem.max_jerk = bounds["jerk"].tolist()
    problem.synchronization = ruckig.Synchronization.Phase
    trajectory = ruckig.Trajectory(joints)
    try:
        ruckig.Ruckig(joints).calculate(problem, trajectory)
    except ruckig.RuckigError as error:
        reason = str(error).replace("[ruckig]", "").strip()
        raise DefinitionError(
            f"`Trapezoidal`: no motion from {short_repr(first)} to {short_repr(last)}: {reason}"
        ) from None
    return trajectory.profiles[0]
