"""The arms of the two examples in a scenario file."""

from __future__ import annotations

from typing import Any, Literal

from slidax._errors import located
from slidax.robots import Scara, TwoLink

from ..base import Description
from .arms import Arms


class TwoLinkParameters(Description):
    """Numbers of a two-link arm."""

    lengths: list[float]
    """Link lengths l1, l2 [m]."""
    masses: list[float]
    """Link masses m1, m2 [kg]."""
    inertias: list[float]
    """Link inertias I1, I2 [kg m²]."""
    gravity_acceleration: float = 9.8
    """g [m/s²]."""


class TwoLinkChanges(Description):
    """What the law believes of the two-link arm; what is not given is as in the plant."""

    lengths: list[float] | None = None
    """Link lengths l1, l2 [m]."""
    masses: list[float] | None = None
    """Link masses m1, m2 [kg]."""
    inertias: list[float] | None = None
    """Link inertias I1, I2 [kg m²]."""
    gravity_acceleration: float | None = None
    """g [m/s²]."""


class ScaraParameters(Description):
    """Numbers of a SCARA arm with point masses."""

    lengths: list[float]
    """Link lengths l1, l2 [m]."""
    masses: list[float]
    """Link masses m1, m2, m3 [kg]."""
    gravity_acceleration: float = 9.8
    """g [m/s²]."""


class ScaraChanges(Description):
    """What the law believes of the SCARA arm; what is not given is as in the plant."""

    lengths: list[float] | None = None
    """Link lengths l1, l2 [m]."""
    masses: list[float] | None = None
    """Link masses m1, m2, m3 [kg]."""
    gravity_acceleration: float | None = None
    """g [m/s²]."""


class TwoLinkDescription(Description):
    """The planar two-link arm of Example 4.1."""

    kind: Literal["two_link"]
    plant: TwoLinkParameters
    """The arm that moves."""
    nominal: TwoLinkChanges = TwoLinkChanges()
    """The arm as the law knows it."""

    def build(self) -> Arms:
        """The true robot and the nominal one."""
        true, known = _both(self.plant, self.nominal)
        with located("plant"):
            plant = TwoLink(**true)
        with located("nominal"):
            return Arms(plant, TwoLink(**known))


class ScaraDescription(Description):
    """The three-joint arm of Example 4.2."""

    kind: Literal["scara"]
    plant: ScaraParameters
    """The arm that moves."""
    nominal: ScaraChanges = ScaraChanges()
    """The arm as the law knows it."""

    def build(self) -> Arms:
        """The true robot and the nominal one."""
        true, known = _both(self.plant, self.nominal)
        with located("plant"):
            plant = Scara(**true)
        with located("nominal"):
            return Arms(plant, Scara(**known))


def _both(plant: Description, changes: Description) -> tuple[dict[str, Any], dict[str, Any]]:
    return plant.parameters(), plant.parameters() | changes.parameters()
