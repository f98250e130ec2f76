"""Trajectories in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from slidax.trajectories import AbstractTrajectory, Constant, ExponentialSum, MinimumJerk, Sinusoid

from .base import Description, Numbers


class ConstantTrajectory(Description):
    """A fixed posture."""

    kind: Literal["constant"]
    value: list[float]
    """The posture, one entry per joint [rad or m]."""

    def build(self) -> AbstractTrajectory:
        """The trajectory."""
        return Constant(**self.parameters())


class SinusoidTrajectory(Description):
    """offset + amplitude sin(frequency t + phase), per joint."""

    kind: Literal["sinusoid"]
    offset: list[float]
    """One entry per joint [rad or m]."""
    amplitude: Numbers
    """[rad or m]"""
    frequency: Numbers
    """[rad/s]"""
    phase: Numbers = 0.0
    """[rad]"""

    def build(self) -> AbstractTrajectory:
        """The trajectory."""
        return Sinusoid(**self.parameters())


class ExponentialSumTrajectory(Description):
    """offset + sum of amplitudes exp(-rate t): a smooth move that comes to rest."""

    kind: Literal["exponential_sum"]
    offset: list[float]
    """Where it comes to rest, one entry per joint [rad or m]."""
    amplitudes: list[list[float]]
    """One row per rate, one column per joint [rad or m]."""
    rates: list[float]
    """[1/s], positive."""

    def build(self) -> AbstractTrajectory:
        """The trajectory."""
        return ExponentialSum(**self.parameters())


class MinimumJerkTrajectory(Description):
    """The smoothest motion through waypoints, at rest at both ends."""

    kind: Literal["minimum_jerk"]
    times: list[float]
    """When each waypoint is passed [s], increasing."""
    waypoints: list[list[float]]
    """One row of joint positions per time [rad or m]."""

    def build(self) -> AbstractTrajectory:
        """The trajectory."""
        return MinimumJerk.through(self.times, self.waypoints)


TrajectoryDescription = Annotated[
    ConstantTrajectory | SinusoidTrajectory | ExponentialSumTrajectory | MinimumJerkTrajectory,
    Field(discriminator="kind"),
]
