"""What the descriptions of several schemes share."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from slidax._errors import as_array, located
from slidax.controllers import AbstractController
from slidax.reaching import StateBound, UncertaintyBound
from slidax.robots import AbstractRobot
from slidax.transformations import PrescribedPerformance

from ..base import Description, Numbers
from .performance import PerformanceDescription
from .sampled_data import SampledDataDescription


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
        return UncertaintyBound(**_renamed(self.parameters()))


class VelocityBoundDescription(Description):
    """The robust torque u, eqs. (45)-(47), for laws without b1."""

    inertia_min: float
    """m1 [1/(kg m²)]."""
    inertia_max: float
    """m2 [1/(kg m²)]."""
    constant: float
    """b0 [N m]."""
    velocity: float
    """b2 [N m s²/rad²]."""
    margin: float
    """k [N m]."""

    def build(self) -> UncertaintyBound:
        """The bound."""
        return UncertaintyBound(**_renamed(self.parameters()), b1=as_array(0.0))


class StateBoundDescription(Description):
    """The bound of the uncertainty by the state, eq. (19)."""

    constant: float
    """b0 [N m]."""
    position: float
    """b1 [N m/rad]."""
    velocity: float
    """b2 [N m s²/rad²]."""

    def build(self) -> StateBound:
        """The bound."""
        return StateBound(**_renamed(self.parameters()))


def _renamed(given: dict[str, Any]) -> dict[str, Any]:
    names = {
        "inertia_min": "inverse_inertia_min",
        "inertia_max": "inverse_inertia_max",
        "constant": "b0",
        "position": "b1",
        "velocity": "b2",
    }
    return {names.get(key, key): value for key, value in given.items()}


class AbstractScheme(Description):
    """What every description of a scheme is: it builds a controller."""

    sampled_data: SampledDataDescription | None = None
    """The scheme at the arm's own rate; the law as it is printed if not given."""

    @abstractmethod
    def build(self, nominal: AbstractRobot) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        """


class AbstractSliding(AbstractScheme):
    """What every description of a scheme with a surface `s = de + phi(t, e)` is."""


class AbstractEnveloped(AbstractSliding):
    """What every description of a scheme with an envelope has."""

    performance: PerformanceDescription
    """The envelope's radius over time."""
    overshoot: Numbers
    """theta in (0, 1), eq. (13)."""

    def envelope(self) -> PrescribedPerformance:
        """The transformation."""
        with located("performance"):
            performance = self.performance.build()
        return PrescribedPerformance(performance, as_array(self.overshoot))
