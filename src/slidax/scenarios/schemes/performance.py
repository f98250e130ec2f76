"""Performance functions in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from slidax.performance import AbstractPerformance, Exponential, FiniteTime, FixedTime

from ..base import Description, Numbers


class FixedTimePerformance(Description):
    """The paper's envelope: settled at its deadline, eq. (20)."""

    kind: Literal["fixed_time"] = "fixed_time"
    initial: Numbers
    """rho0, radius at the start [rad or m], more than the initial error."""
    final: Numbers
    """rho_inf, radius from the deadline on [rad or m]."""
    deadline: Numbers
    """T [s]."""
    exponent: Numbers
    """sigma > 2."""

    def build(self) -> AbstractPerformance:
        """The performance function."""
        return FixedTime(**self.parameters())


class ExponentialPerformance(Description):
    """The classical envelope, settled only in the limit."""

    kind: Literal["exponential"]
    initial: Numbers
    """rho0, radius at the start [rad or m], more than the initial error."""
    final: Numbers
    """rho_inf, radius in the limit [rad or m]."""
    rate: Numbers
    """[1/s]"""

    def build(self) -> AbstractPerformance:
        """The performance function."""
        return Exponential(**self.parameters())


class FiniteTimePerformance(Description):
    """An envelope that settles at a time which depends on its initial radius."""

    kind: Literal["finite_time"]
    initial: Numbers
    """rho0, radius at the start [rad or m], more than the initial error."""
    final: Numbers
    """rho_inf, radius once settled [rad or m]."""
    rate: Numbers
    """c > 0 in d(rho)/dt = -c (rho - rho_inf)^exponent."""
    exponent: Numbers
    """In (1/2, 1)."""

    def build(self) -> AbstractPerformance:
        """The performance function."""
        return FiniteTime(**self.parameters())


PerformanceDescription = Annotated[
    FixedTimePerformance | ExponentialPerformance | FiniteTimePerformance, Field(discriminator="kind")
]
