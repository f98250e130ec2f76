"""Base class of the performance functions."""

from __future__ import annotations

from abc import abstractmethod

from slidax.numerics import value_rate_curvature
from slidax.parts import AbstractPart, PerJoint, Scalar, parameter


class AbstractPerformance(AbstractPart):
    """A positive, decreasing, twice differentiable `ρ(t)` with a positive limit: Definition 4, from [28]."""

    initial: PerJoint = parameter(
        "ρ0, radius at the start, more than the initial error",
        "rad or m",
        "> final",
        "so that the envelope narrows (eq. 20)",
    )
    final: PerJoint = parameter("ρ∞, radius that it narrows to", "rad or m", "> 0", "(Definition 4, eq. 20)")

    @abstractmethod
    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m.

        - `t`: time [s], >= 0.
        """

    def radius_rate_curvature(self, t: Scalar) -> tuple[PerJoint, PerJoint, PerJoint]:
        """`ρ, ρ̇, ρ̈`, each [n], by differentiation.

        - `t`: time [s], >= 0.
        """
        return value_rate_curvature(self.radius, t)
