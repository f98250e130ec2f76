"""What a robot engineer compares with, from the textbooks; the gains are our own choice, for arms like the paper's."""

from __future__ import annotations

from typing import Literal

from slidax._errors import as_array
from slidax.controllers import (
    AbstractController,
    ComputedTorque,
    GravityCompensatedPD,
    SlotineLi,
    SuperTwisting,
)
from slidax.robots import AbstractRobot
from slidax.surfaces import Linear
from slidax.transformations import AbstractTransformation, Unconstrained

from ..base import Numbers
from .parts import AbstractEnveloped, AbstractScheme, AbstractSliding


class ComputedTorqueScheme(AbstractScheme):
    """Computed torque with PD feedback."""

    name: Literal["computed_torque"]
    kp: Numbers = 100.0
    """Diagonal of Kp > 0 [1/s²]."""
    kd: Numbers = 20.0
    """Diagonal of Kd > 0 [1/s]."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return ComputedTorque(nominal, **self.parameters())


class GravityPd(AbstractScheme):
    """PD feedback with gravity compensation."""

    name: Literal["gravity_pd"]
    kp: Numbers = 400.0
    """Diagonal of Kp > 0 [N m/rad or N/m]."""
    kd: Numbers = 100.0
    """Diagonal of Kd > 0 [N m s/rad or N s/m]."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return GravityCompensatedPD(nominal, **self.parameters())


class SlotineLiScheme(AbstractSliding):
    """The classical sliding mode law with a boundary layer (Slotine and Li)."""

    name: Literal["slotine_li"]
    rate: Numbers = 5.0
    """Diagonal of Lambda > 0, how fast the error decays on the surface [1/s]."""
    damping: Numbers = 20.0
    """Diagonal of K_D >= 0 [N m s/rad or N s/m]."""
    gain: Numbers = 20.0
    """K >= 0, size of the robust torque [N m or N]."""
    layer: Numbers = 0.05
    """Half-width of the boundary layer, >= 0 [rad/s or m/s]; 0 gives the sign."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return _slotine_li(self, nominal, Unconstrained())


class SlotineLiPpc(AbstractEnveloped):
    """The classical sliding mode law inside an envelope."""

    name: Literal["slotine_li_ppc"]
    rate: Numbers = 0.6
    """Diagonal of Lambda > 0, on the transformed error [rad/s or m/s]."""
    damping: Numbers = 20.0
    """Diagonal of K_D >= 0 [N m s/rad or N s/m]."""
    gain: Numbers = 20.0
    """K >= 0, size of the robust torque [N m or N]."""
    layer: Numbers = 0.05
    """Half-width of the boundary layer, >= 0 [rad/s or m/s]; 0 gives the sign."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        return _slotine_li(self, nominal, self.envelope())


class SuperTwistingScheme(AbstractScheme):
    """Super-twisting on a linear surface (Levant; Moreno and Osorio)."""

    name: Literal["super_twisting"]
    rate: Numbers = 5.0
    """Diagonal of Lambda > 0, how fast the error decays on the surface [1/s]."""
    k1: Numbers = 12.0
    """Gain of the square root of s, > 0 [rad^(1/2)/s^(3/2)]; 1.5 sqrt(L) for a disturbance's rate L [rad/s³]."""
    k2: Numbers = 70.0
    """Gain of the integral of the sign, > 0 [rad/s³]; 1.1 L."""

    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """
        gains = {key: as_array(value) for key, value in self.parameters().items()}
        return SuperTwisting(nominal, Unconstrained(), Linear(gains.pop("rate")), **gains)


def _slotine_li(
    scheme: SlotineLiScheme | SlotineLiPpc, nominal: AbstractRobot, transformation: AbstractTransformation
) -> SlotineLi:
    return SlotineLi(
        nominal,
        transformation,
        Linear(as_array(scheme.rate)),
        as_array(scheme.damping),
        as_array(scheme.gain),
        as_array(scheme.layer),
    )
