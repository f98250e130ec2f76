"""The paper's scheme and its next of kin: fixed-time terminal sliding modes, with and without an envelope."""

from __future__ import annotations

from typing import Any, Literal

from slidax._errors import located
from slidax.controllers import AbstractController, cftsmppc, ftsmc, ftsmppc
from slidax.robots import AbstractRobot

from ..base import Description, Numbers
from .parts import AbstractEnveloped, AbstractSliding, BoundDescription, VelocityBoundDescription


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
    """Half-width of the core around zero, in (0, 1]."""


class ReachingDescription(Description):
    """-K0 Sig^r(s) - u s/(|s| + s0), eqs. (43), (44), (51)."""

    gain: float | list[float] | list[list[float]] = 0.1
    """K0: one number, a diagonal or a symmetric positive definite matrix."""
    exponent: float = 1.2
    """r > 1."""
    layer: float = 0.05
    """s0 >= 0 [rad/s]; 0 gives the discontinuous law (44)."""

    def gains(self) -> dict[str, Any]:
        """K0, r and s0 by the names of the recipes."""
        return {"k0": self.gain, "r": self.exponent, "layer": self.layer}


class FtsmcSurfaceDescription(Description):
    """K1 S^p + K2 Sig^q with the S^p of (78)."""

    k1: Numbers = 1.5
    """Diagonal of K1 [rad/s or m/s]."""
    k2: Numbers = 1.0
    """Diagonal of K2 [rad/s or m/s]."""
    p: Numbers = 0.5
    """Exponent near zero, in (0, 1)."""
    q: Numbers = 1.2
    """Exponent far from zero, > 1."""
    delta: Numbers = 0.01
    """Half-width of the core around zero, in (0, 1]."""


class FtsmcReachingDescription(Description):
    """-K0 Sig^r(s) - u s/(|s| + s0), eqs. (43), (44), (51)."""

    gain: float | list[float] | list[list[float]] = 1.0
    """K0: one number, a diagonal or a symmetric positive definite matrix."""
    exponent: float = 1.2
    """r > 1."""
    layer: float = 0.0
    """s0 >= 0 [rad/s]; 0, which Table 1 implies, gives the discontinuous law."""

    def gains(self) -> dict[str, Any]:
        """K0, r and s0 by the names of the recipe."""
        return {"k0": self.gain, "r": self.exponent, "layer": self.layer}


class Cftsmppc(AbstractEnveloped):
    """The paper's scheme."""

    name: Literal["cftsmppc"]
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
        return cftsmppc(nominal, **_enveloped(self))


class Ftsmppc(AbstractEnveloped):
    """The paper's scheme on the older surface (78), which has a kink."""

    name: Literal["ftsmppc"]
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
        return ftsmppc(nominal, **_enveloped(self))


class Ftsmc(AbstractSliding):
    """Fixed-time terminal sliding mode without an envelope, the paper's [23]."""

    name: Literal["ftsmc"]
    surface: FtsmcSurfaceDescription = FtsmcSurfaceDescription()
    """The sliding surface."""
    reaching: FtsmcReachingDescription = FtsmcReachingDescription()
    """The reaching law."""
    bound: VelocityBoundDescription
    """The robust torque."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        with located("bound"):
            bound = self.bound.build()
        return ftsmc(nominal, bound=bound, **self.reaching.gains(), **self.surface.parameters())


def _enveloped(scheme: Cftsmppc | Ftsmppc) -> dict[str, Any]:
    with located("performance"):
        performance = scheme.performance.build()
    with located("bound"):
        bound = scheme.bound.build()
    return {
        "performance": performance,
        "overshoot": scheme.overshoot,
        "bound": bound,
        **scheme.reaching.gains(),
        **scheme.surface.parameters(),
    }
