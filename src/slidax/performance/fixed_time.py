"""The paper's performance function, with a prescribed settling time."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.numerics import power
from slidax.parts import PerJoint, Scalar, parameter

from .performance import AbstractPerformance


class FixedTime(AbstractPerformance):
    """`ρ(t) = (ρ0 - ρ∞)(1 - t/T)^σ + ρ∞` for `t < T`, then `ρ∞`, eq. (20)."""

    title = "The paper's performance function, with a prescribed settling time."

    deadline: PerJoint = parameter("T, when it is settled", "s", "> 0", "(eq. 20)")
    exponent: PerJoint = parameter(
        "σ, exponent of the decrease", "", "> 2", "so that the second derivative is continuous at T (eq. 20)"
    )

    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m."""
        left = jnp.maximum(1.0 - t / self.deadline, 0.0)
        return (self.initial - self.final) * power(left, self.exponent) + self.final
