"""Disturbances in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from slidax._errors import located
from slidax.disturbances import AbstractDisturbance, Constant, Friction, Harmonic, Step, Sum

from .base import Description, Numbers


class ConstantTerm(Description):
    """A force that does not change."""

    kind: Literal["constant"]
    value: list[float]
    """One entry per joint [N m or N]."""

    def build(self) -> AbstractDisturbance:
        """The disturbance."""
        return Constant(**self.parameters())


class HarmonicTerm(Description):
    """amplitude sin(frequency t + phase), per joint."""

    kind: Literal["harmonic"]
    amplitude: list[float]
    """One entry per joint [N m or N]."""
    frequency: Numbers
    """[rad/s]"""
    phase: Numbers = 0.0
    """[rad]"""

    def build(self) -> AbstractDisturbance:
        """The disturbance."""
        return Harmonic(**self.parameters())


class StepTerm(Description):
    """A force from a start to an end."""

    kind: Literal["step"]
    value: list[float]
    """One entry per joint [N m or N]."""
    start: float
    """[s]"""
    end: float | None = None
    """[s]; for ever if not given."""

    def build(self) -> AbstractDisturbance:
        """The disturbance."""
        return Step(**self.parameters())


class FrictionTerm(Description):
    """-(coulomb tanh(velocity/smoothing) + viscous velocity), per joint."""

    kind: Literal["friction"]
    coulomb: Numbers
    """[N m or N]"""
    viscous: Numbers = 0.0
    """[N m s/rad or N s/m]"""
    smoothing: Numbers = 0.01
    """Velocity within which the sign turns [rad/s or m/s]."""

    def build(self) -> AbstractDisturbance:
        """The disturbance."""
        return Friction(**self.parameters())


Term = Annotated[ConstantTerm | HarmonicTerm | StepTerm | FrictionTerm, Field(discriminator="kind")]


class DisturbanceDescription(Description):
    """What pushes the joints from outside: the sum of the terms, times the scale."""

    scale: float = 1.0
    """Factor on all terms; 0 switches the disturbance off."""
    terms: tuple[Term, ...] = ()
    """What adds up."""

    def build(self) -> AbstractDisturbance:
        """The disturbance."""
        built = []
        for number, term in enumerate(self.terms):
            with located(f"terms.{number}"):
                built.append(term.build())
        return self.scale * Sum(tuple(built))
