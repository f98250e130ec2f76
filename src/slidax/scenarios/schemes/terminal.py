"""Terminal sliding modes that the paper compares with in Example 4.2, by the numbers of Table 2."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from slidax._errors import located
from slidax.controllers import (
    AbstractController,
    AdaptiveNonsingularFastTerminal,
    NonsingularFastTerminal,
    sfsmc,
)
from slidax.robots import AbstractRobot

from ..base import Description, Numbers
from .parts import AbstractEnveloped, AbstractScheme, AbstractSliding, StateBoundDescription, VelocityBoundDescription


class Nftsmc(AbstractScheme):
    """Nonsingular fast terminal sliding mode, the paper's [7]."""

    name: Literal["nftsmc"]
    bound: StateBoundDescription
    """Bound of the uncertainty."""
    gamma1: Numbers = 2.0
    """Gamma1, exponent of the error, > gamma2."""
    gamma2: Numbers = 5.0 / 3.0
    """Gamma2, exponent of the velocity error, in (1, 2)."""
    reach: float = 2.0
    """M1 > 0, what is added to the robust acceleration [rad/s²]."""
    gain: Numbers = 2.0
    """M2 > 0 [1/s²]."""
    layer: float = 0.0
    """s0 >= 0 [rad]; 0 gives the discontinuous law."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        with located("bound"):
            bound = self.bound.build()
        return NonsingularFastTerminal(nominal, **self.parameters() | {"bound": bound})


class Anftsmc(AbstractScheme):
    """Adaptive nonsingular fast terminal sliding mode, the paper's [10]."""

    name: Literal["anftsmc"]
    k1: Numbers = 1.0
    """Gain of the error's power, > 0."""
    k2: Numbers = 1.0
    """Gain of the velocity error's power, > 0."""
    alpha: Numbers = 2.0
    """Exponent of the error, > beta; the paper prints .2, with which the law is singular."""
    beta: Numbers = 5.0 / 3.0
    """Exponent of the velocity error, in (1, 2)."""
    gain: Numbers = 250.0
    """k > 0 [1/s²]."""
    margin: float = 0.5
    """eta > 0 [rad/s²]."""
    adaptation: list[float] = Field(default=[0.01, 0.01, 0.01])
    """lambda0, lambda1, lambda2 >= 0: how fast the bound of the uncertainty is learnt."""
    initial: list[float] = Field(default=[0.0, 0.0, 0.0])
    """The learnt b0, b1, b2 at the start, >= 0."""
    layer: Numbers = 0.0
    """Half-width of the boundary layer, >= 0 [rad]; 0 gives the discontinuous law."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return AdaptiveNonsingularFastTerminal(nominal, **self.parameters())


class SingularityFreeSurfaceDescription(Description):
    """C1 S_alpha + C2 Sig^beta."""

    c1: Numbers = 2.0
    """Diagonal of C1 > 0 [rad/s or m/s]."""
    c2: Numbers = 2.0
    """Diagonal of C2 > 0 [rad/s or m/s]."""
    alpha: Numbers = 0.7
    """Exponent near zero, in (0, 1)."""
    beta: Numbers = 1.9
    """Exponent far from zero, > 1."""
    r: Numbers = 1.7
    """Exponent in the core, > 1."""
    delta: Numbers = 0.3
    """Half-width of the core around zero, > 0 [rad or m]."""


class TwoPowerReachingDescription(Description):
    """-K1 Sig^v1(s) - K2 Sig^v2(s) - u s/(|s| + s0)."""

    k1: Numbers = 5.0
    """Diagonal of K1 > 0 [N m]."""
    k2: Numbers = 5.0
    """Diagonal of K2 > 0 [N m]."""
    v1: float = 2.5
    """Exponent far from the surface, > 1."""
    v2: float = 0.5
    """Exponent near the surface, in (0, 1)."""
    layer: float = 0.0
    """s0 >= 0 [rad/s]; 0 gives the discontinuous law."""


class Sfsmc(AbstractSliding):
    """Singularity-free fixed-time sliding mode, the paper's [24]."""

    name: Literal["sfsmc"]
    surface: SingularityFreeSurfaceDescription = SingularityFreeSurfaceDescription()
    """The sliding surface."""
    reaching: TwoPowerReachingDescription = TwoPowerReachingDescription()
    """The reaching law."""
    bound: VelocityBoundDescription
    """The robust torque; a0 is its `constant`, a1 its `velocity`."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return sfsmc(nominal, **_singularity_free(self))


class EnvelopedSurfaceDescription(Description):
    """C1 S_alpha + C2 Sig^beta on the transformed error; our own choice, after Table 1's CFTSMPPC."""

    c1: Numbers = 0.2
    """Diagonal of C1 > 0 [rad/s or m/s]."""
    c2: Numbers = 0.6
    """Diagonal of C2 > 0 [rad/s or m/s]."""
    alpha: Numbers = 0.7
    """Exponent near zero, in (0, 1)."""
    beta: Numbers = 1.2
    """Exponent far from zero, > 1."""
    r: Numbers = 1.7
    """Exponent in the core, > 1."""
    delta: Numbers = 0.3
    """Half-width of the core around zero, > 0."""


class EnvelopedReachingDescription(Description):
    """-K1 Sig^v1(s) - K2 Sig^v2(s) - u s/(|s| + s0), with the boundary layer of Table 1's CFTSMPPC."""

    k1: Numbers = 5.0
    """Diagonal of K1 > 0 [N m]."""
    k2: Numbers = 5.0
    """Diagonal of K2 > 0 [N m]."""
    v1: float = 2.5
    """Exponent far from the surface, > 1."""
    v2: float = 0.5
    """Exponent near the surface, in (0, 1)."""
    layer: float = 0.05
    """s0 >= 0 [rad/s]; 0 gives the discontinuous law."""


class Sfsmppc(AbstractEnveloped):
    """The singularity-free scheme inside an envelope."""

    name: Literal["sfsmppc"]
    surface: EnvelopedSurfaceDescription = EnvelopedSurfaceDescription()
    """The sliding surface."""
    reaching: EnvelopedReachingDescription = EnvelopedReachingDescription()
    """The reaching law."""
    bound: VelocityBoundDescription
    """The robust torque; a0 is its `constant`, a1 its `velocity`."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return sfsmc(nominal, transformation=self.envelope(), **_singularity_free(self))


def _singularity_free(scheme: Sfsmc | Sfsmppc) -> dict[str, Any]:
    with located("bound"):
        bound = scheme.bound.build()
    return {"bound": bound, **scheme.surface.parameters(), **scheme.reaching.parameters()}
