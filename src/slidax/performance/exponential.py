"""The classical exponential performance function."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Scalar, parameter

from .performance import AbstractPerformance


class Exponential(AbstractPerformance):
    """`ρ(t) = (ρ0 - ρ∞) exp(-l t) + ρ∞`. Source: Bechlioulis and Rovithakis, 2008, the paper's [28]."""

    title = "The classical exponential performance function."

    rate: PerJoint = parameter("l, how fast it narrows", "1/s", "> 0", "so that the envelope narrows (Definition 4)")

    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m."""
        return (self.initial - self.final) * jnp.exp(-self.rate * t) + self.final
