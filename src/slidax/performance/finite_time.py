"""A performance function with a settling time that depends on its initial value."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.numerics import power
from slidax.parts import PerJoint, Scalar, parameter

from .performance import AbstractPerformance


class FiniteTime(AbstractPerformance):
    """The solution of `ρ̇ = -c (ρ - ρ∞)^κ`: `ρ(t) = ((ρ0 - ρ∞)^(1-κ) - (1-κ) c t)^(1/(1-κ)) + ρ∞`, then `ρ∞`.

    It settles at `T = (ρ0 - ρ∞)^(1-κ) / ((1-κ) c)`, which grows with ρ0; this is the paper's objection to the
    finite-time functions it cites as [43]. Reconstructed: the paper does not print that function; this one is usual.
    """

    title = "A performance function with a settling time that depends on its initial value."

    rate: PerJoint = parameter(
        "c, how fast it narrows", "rad^(1-κ)/s", "> 0", "so that the envelope narrows (Definition 4)"
    )
    exponent: PerJoint = parameter(
        "κ, exponent of the decrease",
        "",
        "(1/2, 1)",
        "so that the second derivative is continuous where the function settles",
    )

    @property
    def deadline(self) -> PerJoint:
        """`T`, the settling time, [n], s."""
        a = 1.0 - self.exponent
        return power(self.initial - self.final, a) / (a * self.rate)

    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m."""
        a = 1.0 - self.exponent
        left = jnp.maximum(power(self.initial - self.final, a) - a * self.rate * t, 0.0)
        return power(left, 1.0 / a) + self.final
