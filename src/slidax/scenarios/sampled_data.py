"""The sampled-data form of a scheme in a scenario file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from jaxtyping import Array

from slidax._errors import as_array, located
from slidax.actuators import TorqueLimits
from slidax.controllers import AbstractController, Recovery, sampled_data
from slidax.estimators import AbstractEstimator, Kalman, Measured
from slidax.estimators.kalman import TORQUE_DENSITY

from .base import AbstractDescription, Numbers, said, same
from .derived import PartDescription, plain_of, union_of


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


class MeasuredDescription(AbstractDescription):
    """Trusts positions and velocities as measured, and learns the disturbance from the velocities."""

    kind: Literal["measured"]
    gain: Numbers = same(Measured, "gain")
    trend: Numbers | None = same(Measured, "trend", default=None, source="critically damped")

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """The estimator.

        - `sampling`: how the arm is sampled.
        """
        if self.trend is None:
            return Measured.critical(self.gain, sampling.delay + 1.0)
        return Measured(as_array(self.gain), as_array(self.trend), as_array(sampling.delay + 1.0))


class KalmanDescription(AbstractDescription):
    """Velocities and disturbance from positions alone, by a steady Kalman filter."""

    kind: Literal["kalman"]
    torque_density: Numbers = said(
        "of the white noise that drives the disturbance",
        "(N m/s)² s",
        default=TORQUE_DENSITY,
        source="docs/loop-rate.md",
    )
    variance: Numbers | None = said(
        "of a measured position", "rad² or m²", default=None, source="the sensor's resolution and noise"
    )

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """The estimator.

        - `sampling`: how the arm is sampled.
        """
        variance = sampling.variance if self.variance is None else as_array(self.variance)
        return Kalman.of_arm(
            sampling.mass, variance=variance, period=sampling.period, torque_density=self.torque_density
        )


if TYPE_CHECKING:
    EstimatorDescription = PartDescription
    RecoveryDescription = PartDescription
else:
    RecoveryDescription = plain_of(Recovery, "RecoveryDescription")
    EstimatorDescription = union_of(AbstractEstimator, MeasuredDescription, KalmanDescription)


class SampledDataDescription(AbstractDescription):
    """The scheme as implicit steps at the arm's own rate; what is not given fits the sensor and the actuator."""

    horizon: float | None = said(
        "H, how far a step plans, at least a period",
        "s",
        "> 0",
        default=None,
        source="12 ms, or two periods if that is more",
    )
    estimator: EstimatorDescription | None = None
    """From measurements to the state and the disturbance; if not given `measured`, with gains after the horizon, or
    `kalman` for encoders without a velocity sensor."""
    delay: float | None = said(
        "age of a measurement when its torque sets in, as the law believes it",
        "periods",
        "[0, 100]",
        default=None,
        source="as the sensor and the actuator say",
    )
    recovery: RecoveryDescription | None = RecoveryDescription()
    """What to do outside the envelope; null: pull back to the drawn envelope as it is."""
    slopes: bool = True
    """Whether the robust torque counts the slope part of tau1, as (45) prints it."""

    def build(self, law: AbstractController, sampling: Sampling) -> AbstractController:
        """The sampled-data form of a law.

        - `law`: the law in continuous time.
        - `sampling`: how the arm is sampled.

        Raises DefinitionError if the law has no such form.
        """
        if self.delay is not None:
            sampling = replace(sampling, delay=self.delay, dead_time=min(sampling.dead_time, self.delay))
        estimator: AbstractEstimator | None = None
        with located("estimator"):
            if self.estimator is not None:
                self.estimator.require_joints(sampling.mass.shape[0])
                how = (sampling,) if isinstance(self.estimator, MeasuredDescription | KalmanDescription) else ()
                estimator = self.estimator.build(*how)
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
