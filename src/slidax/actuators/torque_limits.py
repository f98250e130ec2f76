"""Torque and torque-rate limits."""

from __future__ import annotations

import math

import jax.numpy as jnp

from slidax.parts import AbstractPart, PerJoint, Scalar, Vector, parameter


class TorqueLimits(AbstractPart):
    """`|τ| <= torque`, and within that `|τ - τ₋| <= rate h` from one sample to the next, per joint.

    The drive enforces them; a controller may know them and plan with them.
    """

    torque: PerJoint = parameter("largest torque", "N m or N", "(0, inf]", default=math.inf)
    rate: PerJoint = parameter("fastest change of the torque", "N m/s or N/s", "(0, inf]", default=math.inf)

    def __call__(self, tau: Vector, last: Vector, period: Scalar) -> Vector:
        """The torque nearest to `tau` within `last ± rate period`, and of those within `±torque`, [n], N m or N.

        The torque's limit holds also where the last torque was beyond it, and the rate's then does not.

        - `tau`: wanted torque [n], N m or N.
        - `last`: torque of the last sample [n], N m or N.
        - `period`: time between two samples [s], > 0.
        """
        # An infinite rate times a period is kept out of the derivatives.
        finite = jnp.isfinite(self.rate)
        change = jnp.where(finite, jnp.where(finite, self.rate, 0.0) * period, math.inf)
        lower, upper = (jnp.clip(last + side, -self.torque, self.torque) for side in (-change, change))
        return jnp.clip(tau, lower, upper)
