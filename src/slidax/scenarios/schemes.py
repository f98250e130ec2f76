"""Control schemes in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from slidax._errors import located
from slidax.controllers import AbstractController, cftsmppc
from slidax.performance import AbstractPerformance, Exponential, FiniteTime, FixedTime
from slidax.reaching import UncertaintyBound
from slidax.robots import AbstractRobot

from .base import Description, Numbers


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


class SurfaceDescription(Description):
    """K1 S^p + K2 S^q, eqs. (29)-(40)."""

    k1: Numbers = 0.2
    """Diagonal of K1 [rad/s or m/s]."""
    k2: Numbers = 0.6
    """Diagonal of K2 [rad/s or m/s]."""
    p: Numbers = 0.5
    """Exponent near zero, in (0, 1)."""
    q: Numbers = 1.2
    """Exponent far from zero, > 1."""
    delta: Numbers = 0.01
    """Half-width of the smooth core, in (0, 1]."""


class ReachingDescription(Description):
    """-K0 Sig^r(s) - u s/(|s| + s0), eqs. (43), (44), (51)."""

    gain: float | list[float] | list[list[float]] = 0.1
    """K0: one number, a diagonal or a symmetric positive definite matrix."""
    exponent: float = 1.2
    """r > 1."""
    layer: float = 0.05
    """s0 >= 0 [rad/s]; 0 gives the discontinuous law (44)."""


class BoundDescription(Description):
    """The robust torque u, eqs. (45)-(47)."""

    inertia_min: float
    """m1 [1/(kg m²)]."""
    inertia_max: float
    """m2 [1/(kg m²)]."""
    constant: float
    """b0 [N m]."""
    position: float
    """b1 [N m/rad]."""
    velocity: float
    """b2 [N m s²/rad²]."""
    margin: float
    """k [N m]."""

    def build(self) -> UncertaintyBound:
        """The bound."""
        return UncertaintyBound(**self.parameters())


class Cftsmppc(Description):
    """The paper's scheme."""

    name: Literal["cftsmppc"]
    performance: PerformanceDescription
    """The envelope's radius over time."""
    overshoot: Numbers
    """theta in (0, 1), eq. (13)."""
    surface: SurfaceDescription = SurfaceDescription()
    """The sliding surface."""
    reaching: ReachingDescription = ReachingDescription()
    """The reaching law."""
    bound: BoundDescription
    """The robust torque."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        with located("performance"):
            performance = self.performance.build()
        with located("bound"):
            bound = self.bound.build()
        return cftsmppc(
            nominal,
            performance=performance,
            overshoot=self.overshoot,
            bound=bound,
            k0=self.reaching.gain,
            r=self.reaching.exponent,
            layer=self.reaching.layer,
            **self.surface.parameters(),
        )


SchemeDescription = Cftsmppc
