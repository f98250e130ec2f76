"""Performance functions: prescribed bounds of the tracking error over time.

The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w, and [28] a reference of it.
"""

from __future__ import annotations

from abc import abstractmethod

import jax.numpy as jnp

from slidax.core.integrators import value_rate_curvature
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.powers import power
from slidax.core.types import PerJoint, Scalar


class AbstractPerformance(AbstractPart):
    """Radius ρ(t) of the error envelope: positive, decreasing, twice differentiable, with a positive limit.

    The paper's Definition 4, which it takes from [28].
    """

    initial: PerJoint = parameter(
        "ρ0, radius at the start, more than the initial error",
        "rad or m",
        "> final",
        "so that the envelope narrows (eq. 20)",
    )
    final: PerJoint = parameter("ρ∞, final radius", "rad or m", "> 0", "(Definition 4, eq. 20)")

    @abstractmethod
    def radius(self, t: Scalar) -> PerJoint:
        """Return the radius `ρ(t)`, [n] or one number, rad or m.

        - `t`: time [s], >= 0.
        """

    def radius_rate_curvature(self, t: Scalar) -> tuple[PerJoint, PerJoint, PerJoint]:
        """Return ρ and its first and second time derivatives, by automatic differentiation; each as `radius`.

        - `t`: time [s], >= 0.
        """
        return value_rate_curvature(self.radius, t)


class FixedTime(AbstractPerformance):
    """`ρ(t) = (ρ0 - ρ∞)(1 - t/T)^σ + ρ∞` for `t < T`, then `ρ∞`: the paper's eq. (20)."""

    title = "The paper's performance function, with a prescribed settling time."

    deadline: PerJoint = parameter("T, time from which the radius is ρ∞", "s", "> 0", "(eq. 20)")
    exponent: PerJoint = parameter(
        "σ, exponent of the decrease", "", "> 2", "so that the second derivative is continuous at T (eq. 20)"
    )

    def radius(self, t: Scalar) -> PerJoint:
        left = jnp.maximum(1.0 - t / self.deadline, 0.0)
        return (self.initial - self.final) * power(left, self.exponent) + self.final


class FiniteTime(AbstractPerformance):
    """The solution of `ρ̇ = -c (ρ - ρ∞)^κ`: `ρ(t) = ((ρ0 - ρ∞)^(1-κ) - (1-κ) c t)^(1/(1-κ)) + ρ∞`, then `ρ∞`.

    It settles at `T = (ρ0 - ρ∞)^(1-κ) / ((1-κ) c)`, which grows with ρ0; this is the paper's objection to the
    finite-time functions it cites as [43]. Reconstructed: the paper does not print that function; this form is common.
    """

    title = "A performance function with a settling time that depends on its initial value."

    rate: PerJoint = parameter(
        "c, rate of the decrease", "rad^(1-κ)/s", "> 0", "so that the envelope narrows (Definition 4)"
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
        a = 1.0 - self.exponent
        left = jnp.maximum(power(self.initial - self.final, a) - a * self.rate * t, 0.0)
        return power(left, 1.0 / a) + self.final


class Exponential(AbstractPerformance):
    """`ρ(t) = (ρ0 - ρ∞) exp(-l t) + ρ∞`. Source: Bechlioulis and Rovithakis, 2008, the paper's [28]."""

    title = "The classical exponential performance function."

    rate: PerJoint = parameter("l, rate of the decrease", "1/s", "> 0", "so that the envelope narrows (Definition 4)")

    def radius(self, t: Scalar) -> PerJoint:
        return (self.initial - self.final) * jnp.exp(-self.rate * t) + self.final
