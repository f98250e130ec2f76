"""The sampled-data form of a scheme in a scenario file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from jaxtyping import Array
from pydantic import Field

from slidax._errors import as_array, located
from slidax.actuators import TorqueLimits
from slidax.controllers import AbstractController, Recovery, SampledData, sampled_data
from slidax.estimators import AbstractEstimator, FilteredDifference, Kalman, Measured, RobustDifferentiator
from slidax.estimators.kalman import TORQUE_DENSITY

from ..base import Description, Numbers


@dataclass(frozen=True)
class Sampling:
    """How an arm is sampled, as far as its law has to know.

    - `period`: time between samples [s].
    - `delay`: age of a measurement when its torque sets in [periods].
    - `dead_time`: the part of it after the command [periods].
    - `limits`: of torque and torque rate.
    - `variance`: of a measured position, one number or [n], rad² or m².
    - `has_velocity`: whether velocities are measured, too.
    - `mass`: inertia matrix of the nominal arm at the start [n n].
    """

    period: float
    delay: float
    dead_time: float
    limits: TorqueLimits
    variance: Array
    has_velocity: bool
    mass: Array


class MeasuredDescription(Description):
    """Trusts positions and velocities as measured, and learns the disturbance from the velocities."""

    kind: Literal["measured"]
    gain: Numbers = 0.5
    """Of the disturbance estimate, in [0, 1]; 0 for none."""
    trend: Numbers | None = None
    """Gain of its rate, >= 0; critically damped if not given."""

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """The estimator.

        - `sampling`: how the arm is sampled.
        """
        if self.trend is None:
            return Measured.critical(self.gain, sampling.delay + 1.0)
        return Measured(as_array(self.gain), as_array(self.trend), as_array(sampling.delay + 1.0))


class KalmanDescription(Description):
    """Velocities and disturbance from positions alone, by a steady Kalman filter."""

    kind: Literal["kalman"]
    torque_density: Numbers = TORQUE_DENSITY
    """Of the white noise that drives the disturbance [(N m/s)² s]."""
    variance: Numbers | None = None
    """Of a measured position [rad² or m²]; after the sensor's resolution and noise if not given."""

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """The estimator.

        - `sampling`: how the arm is sampled.
        """
        variance = sampling.variance if self.variance is None else as_array(self.variance)
        return Kalman.of_arm(
            sampling.mass, variance=variance, period=sampling.period, torque_density=self.torque_density
        )


class FilteredDifferenceDescription(Description):
    """Velocities from differences of positions, filtered around the model."""

    kind: Literal["filtered_difference"]
    cutoff: Numbers
    """[rad/s]"""
    gain: Numbers = 0.25
    """Of the disturbance estimate, in [0, 1]."""

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """The estimator.

        - `sampling`: not used.
        """
        return FilteredDifference(as_array(self.cutoff), as_array(self.gain))


class RobustDifferentiatorDescription(Description):
    """Velocities and disturbance from positions alone, by Levant's differentiator, implicit in time."""

    kind: Literal["robust_differentiator"]
    lipschitz: Numbers
    """How fast the disturbance may change [rad/s³]."""

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """The estimator.

        - `sampling`: not used.
        """
        return RobustDifferentiator(as_array(self.lipschitz))


class RecoveryDescription(Description):
    """What to do outside the envelope: draw a new one around the error, which narrows into the old."""

    deadline: float = 0.3
    """Least time for the way back [s]."""
    room: float = 1.6
    """How much wider than needed to brake, > 1."""
    share: float = 0.25
    """Of the acceleration at hand that it may ask for, in (0, 1)."""

    def build(self) -> Recovery:
        """The policy."""
        return Recovery(**self.parameters())


EstimatorDescription = Annotated[
    MeasuredDescription | KalmanDescription | FilteredDifferenceDescription | RobustDifferentiatorDescription,
    Field(discriminator="kind"),
]


class SampledDataDescription(Description):
    """The scheme as implicit steps at the arm's own rate; what is not given fits the sensor and the actuator."""

    horizon: Annotated[float, Field(gt=0)] | None = None
    """H [s], at least a period; 12 ms, or two periods if that is more, if not given."""
    estimator: EstimatorDescription | None = None
    """From measurements to the state and the disturbance; if not given `measured`, with gains after the horizon, or
    `kalman` for encoders without a velocity sensor."""
    recovery: RecoveryDescription | None = RecoveryDescription()
    """What to do outside the envelope; null: pull back to the drawn one as it is."""
    slopes: bool = True
    """Whether the robust torque counts the slope part of tau1, as (45) prints it."""

    def build(self, law: AbstractController, sampling: Sampling) -> SampledData:
        """The sampled-data form of a law.

        - `law`: the law in continuous time.
        - `sampling`: how the arm is sampled.

        Raises DefinitionError if the law has no such form.
        """
        estimator: AbstractEstimator | None = None
        with located("estimator"):
            if self.estimator is not None:
                self.estimator.require_joints(sampling.mass.shape[0])
                estimator = self.estimator.build(sampling)
            elif not sampling.has_velocity:
                estimator = KalmanDescription(kind="kalman").build(sampling)
        recovery = None
        if self.recovery is not None:
            with located("recovery"):
                recovery = self.recovery.build()
        return sampled_data(
            law,
            period=sampling.period,
            horizon=self.horizon,
            estimator=estimator,
            limits=sampling.limits,
            recovery=recovery,
            delay=sampling.delay,
            dead_time=sampling.dead_time,
            slopes=self.slopes,
        )
