"""Minimum-jerk motion through waypoints."""

from __future__ import annotations

import numpy as np

from slidax.parts import DefinitionError, as_array, shown

from .motion_limits import limit
from .piecewise_polynomial import AbstractPiecewisePolynomial
from .quintic_spline import quintic_spline
from .shortest_times import shortest_times
from .waypoints import distinct_waypoints, positions

MOST_TIMED_WAYPOINTS = 100
"""Waypoints whose times are searched together: the search takes memory by their square, and time by their cube."""


class MinimumJerk(AbstractPiecewisePolynomial):
    """The curve through all waypoints at their times with the least `∫ ‖d³q_d/dt³‖² dt`, at rest at both ends.

    It is the quintic spline with four continuous derivatives and with zero velocity and acceleration at both ends.
    Between two waypoints only, it is `q_0 + (q_1 - q_0)(10 z³ - 15 z⁴ + 6 z⁵)`, `z = (t - t_0)/(t_1 - t_0)` (Flash and
    Hogan, 1985). It stands still before the first waypoint and after the last.

    `MinimumJerk.through(times, waypoints)` makes it; `MinimumJerk.within(waypoints, velocity=..., acceleration=...)`
    finds the shortest times within limits.
    """

    @staticmethod
    def through(times: object, waypoints: object) -> MinimumJerk:
        """Return the motion through waypoints at given times.

        - `times`: [k], s, strictly increasing, at least two.
        - `waypoints`: positions [k n], rad or m.

        Raises DefinitionError if the times do not increase or do not fit the waypoints.
        """
        t = np.asarray(times, dtype=float)
        if t.ndim != 1 or len(t) < 2 or not np.all(np.diff(t) > 0) or not np.all(np.isfinite(t)):
            raise DefinitionError(f"`MinimumJerk.times` must be two or more increasing times; got {shown(t)}")
        q = positions("MinimumJerk", waypoints)
        if len(q) != len(t):
            raise DefinitionError(
                f"`MinimumJerk.waypoints` must be one row of joint positions for each of the {len(t)} times; "
                f"got {len(q)}"
            )
        if not np.all(np.diff(t) > 1e-9 * (t[-1] - t[0])):
            raise DefinitionError(f"`MinimumJerk.times` lie too close together; got {shown(t)}")
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
        """Return the motion through waypoints at the shortest times for which no joint passes a limit.

        The limits hold exactly, since the extremes of the polynomials are compared, and one joint reaches one of its
        limits. The times are the shortest for two waypoints; for more, they are those that a local search finds.

        - `waypoints`: positions [k n], rad or m, no two in a row the same.
        - `velocity`, `acceleration`, `jerk`: limits, [n] or one number, rad/s, rad/s², rad/s³ or m/s, m/s², m/s³;
          infinite, or for the jerk None, for no limit.
        - `start`: time of the first waypoint [s].

        Raises DefinitionError for invalid waypoints or a limit that is not positive.
        """
        name = "MinimumJerk"
        q = distinct_waypoints(name, waypoints)
        if len(q) > MOST_TIMED_WAYPOINTS:
            raise DefinitionError(
                f"`{name}.within` finds the times of at most {MOST_TIMED_WAYPOINTS} waypoints; got {len(q)}; "
                f"give their times to `{name}.through`, or move from rest to rest by `Trapezoidal.through`"
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
                "or it could go there in no time"
            )
        return MinimumJerk.through(shortest_times(q, limits) + start, q)
