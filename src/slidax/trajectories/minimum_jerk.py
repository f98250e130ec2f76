"""The smoothest motion through waypoints."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax._errors import DefinitionError, parameter
from slidax._types import Scalar, Vector

from .trajectory import AbstractTrajectory


class MinimumJerk(AbstractTrajectory):
    """The curve through all waypoints at their times that has the least `∫ ‖d³q_d/dt³‖² dt`, at rest at both ends.

    It is the quintic spline with four continuous derivatives, with zero velocity and acceleration at the first and the
    last waypoint; between two waypoints only, it is `q_0 + (q_1 - q_0)(10 z³ - 15 z⁴ + 6 z⁵)`,
    `z = (t - t_0)/(t_1 - t_0)` (Flash and Hogan, 1985). Before the first waypoint and after the last it stands still.

    - `times`: knots [k], s, increasing.
    - `coefficients`: of each piece in powers of `t - times[i]`, highest first, [6 k-1 n].

    Made by `MinimumJerk.through(times, waypoints)`.
    """

    times: Float[Array, " k"] = eqx.field(converter=parameter)
    coefficients: Float[Array, "6 pieces n"] = eqx.field(converter=parameter)

    @staticmethod
    def through(times: object, waypoints: object) -> MinimumJerk:
        """The motion through the given waypoints.

        - `times`: [k], s, strictly increasing, at least two.
        - `waypoints`: positions [k n], rad or m.

        Raises DefinitionError if the times do not increase or do not fit the waypoints.
        """
        from scipy.interpolate import make_interp_spline

        t = np.asarray(times, dtype=float)
        q = np.asarray(waypoints, dtype=float)
        if t.ndim != 1 or len(t) < 2 or not np.all(np.diff(t) > 0) or not np.all(np.isfinite(t)):
            raise DefinitionError(f"`MinimumJerk.times` must be two or more increasing times; got {t.tolist()}")
        if q.ndim != 2 or len(q) != len(t) or not np.all(np.isfinite(q)):
            raise DefinitionError(
                f"`MinimumJerk.waypoints` must be one finite row of joint positions for each of the {len(t)} times; "
                f"got shape {list(q.shape)}"
            )
        rest = np.zeros(q.shape[1])
        ends = [(1, rest), (2, rest)]
        # Solved on [0, 1]: with the times themselves the fifth-degree basis is ill-conditioned for long motions.
        span = t[-1] - t[0]
        z = (t - t[0]) / span
        if not np.all(np.diff(z) > 1e-9):
            raise DefinitionError(f"`MinimumJerk.times` lie too close together; got {t.tolist()}")
        spline = make_interp_spline(z, q, k=5, bc_type=(ends, ends))
        # The Taylor coefficients at the left end of each piece, where the spline and its derivatives are exact.
        pieces = np.stack([spline(z[:-1], nu=i) / (math.factorial(i) * span**i) for i in reversed(range(6))])
        return MinimumJerk(times=parameter(t), coefficients=parameter(pieces))

    def position(self, t: Scalar) -> Vector:
        """The position on the piece that holds `t`.

        - `t`: time [s].
        """
        t = jnp.clip(t, self.times[0], self.times[-1])
        piece = jnp.clip(jnp.searchsorted(self.times, t, side="right") - 1, 0, self.coefficients.shape[1] - 1)
        c = self.coefficients[:, piece]
        x = t - self.times[piece]
        return ((((c[0] * x + c[1]) * x + c[2]) * x + c[3]) * x + c[4]) * x + c[5]
