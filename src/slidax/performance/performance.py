"""What every performance function is."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx

from slidax._errors import known, require
from slidax._types import PerJoint, Scalar
from slidax.numerics import value_rate_curvature


class AbstractPerformance(eqx.Module):
    """A positive, decreasing, twice differentiable `ρ(t)` with a positive limit: Definition 4, from [28]."""

    initial: eqx.AbstractVar[PerJoint]
    final: eqx.AbstractVar[PerJoint]

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


def require_narrowing(performance: AbstractPerformance) -> None:
    """Raises a DefinitionError unless `0 < ρ∞ < ρ0`.

    - `performance`: the function to check.
    """
    initial, final = known(performance.initial), known(performance.final)
    require(performance, "final", final > 0, "must be > 0 (Definition 4, eq. 20)")
    rule = f"must be > `final` = {performance.final}, so that the envelope narrows (eq. 20)"
    require(performance, "initial", initial > final, rule)
