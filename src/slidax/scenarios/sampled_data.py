"""The sampled-data form of a scheme in a scenario file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from pydantic import field_validator

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, as_array, locate_errors
from slidax.law.adaptation import AbstractAdaptation
from slidax.law.controllers import AbstractController
from slidax.law.estimators import AbstractEstimator, Measured
from slidax.law.joint_learning import JointLearning
from slidax.law.kalman import FASTEST_PACE, TORQUE_DENSITY, Kalman
from slidax.law.sampled.gate import MeasurementGate
from slidax.law.sampled.monitor import Monitor
from slidax.law.sampled.recipe import sampled_data
from slidax.law.steps import Recovery
from slidax.plant.actuators import TorqueLimits

from .descriptions import AbstractDescription, Numbers, PartDescription, input_field, plain_of, same_field, union_of

FINEST = 2e-6
"""rad: finest encoder resolution that a Kalman filter with an adaptation assumes; a faster filter tolerates smaller
errors of the inertia (docs/learning.md)."""


@dataclass(frozen=True)
class Sampling:
    """Sampling of an arm, for its law.

    - `period`: time between samples [s].
    - `delay`: age of a measurement when its torque sets in [periods].
    - `dead_time`: part of the delay after the command [periods].
    - `limits`: of torque and torque rate.
    - `variance`: of a measured position, one number or [n], rad² or m².
    - `has_velocity`: True if velocities are measured, too.
    - `mass`: inertia matrix of the nominal arm at the start [n n].
    - `rotors`: its rotor inertia [n], kg m² or kg; None for an arm whose model has no rotors.
    - `rated`: rated torque of its joints [n], N m or N; infinite if it is not known.
    - `limited`: False if the arm may move beyond its limits.
    - `jitter`: width of the spread of a measurement's age [periods].
    """

    period: float
    delay: float
    dead_time: float
    limits: TorqueLimits
    variance: Array
    has_velocity: bool
    mass: Array
    rotors: Array | None
    rated: Array
    limited: bool = True
    jitter: float = 0.0


class MeasuredDescription(AbstractDescription):
    """Trusts positions and velocities as measured, and learns the disturbance from the velocities."""

    kind: Literal["measured"]
    gain: Numbers | None = same_field(
        Measured, "gain", default=None, source="1/6, or .3 with a delay of more than one period"
    )
    trend: Numbers | None = same_field(
        Measured, "trend", default=None, source="critically damped, or 0 with a delay of more than one period"
    )

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """Build the estimator."""
        default = Measured.tolerant(sampling.delay)
        gain = default.gain if self.gain is None else as_array(self.gain)
        if self.trend is not None:
            return Measured(gain, as_array(self.trend), as_array(sampling.delay + 1.0))
        return Measured.critical(gain, sampling.delay + 1.0) if sampling.delay <= 1.0 else Measured(gain)


class KalmanDescription(AbstractDescription):
    """Velocities and disturbance from positions alone, by a steady Kalman filter."""

    kind: Literal["kalman"]
    torque_density: Numbers = input_field(
        "of the white noise that drives the disturbance",
        "(N m/s)² s",
        default=TORQUE_DENSITY,
        source="docs/loop-rate.md",
    )
    acceleration_density: float | None = input_field(
        "of the white noise that drives the disturbance as an acceleration, in place of `torque_density`: the same "
        "gains for all joints",
        "(rad/s³)² s or (m/s³)² s",
        "> 0",
        default=None,
    )
    variance: Numbers | None = input_field(
        "of a measured position", "rad² or m²", default=None, source="the sensor's resolution and noise"
    )

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """Build the estimator."""
        variance = sampling.variance if self.variance is None else as_array(self.variance)
        if self.acceleration_density is not None:
            if "torque_density" in self.model_fields_set:
                raise DefinitionError(
                    "`acceleration_density` and `torque_density` both set the gains: leave one of them out"
                )
            return Kalman.steady(density=self.acceleration_density, variance=variance, period=sampling.period)
        return Kalman.of_arm(
            sampling.mass,
            variance=variance,
            period=sampling.period,
            torque_density=self.torque_density,
            fastest=FASTEST_PACE if self.variance is None else None,
        )


class GateDescription(AbstractDescription):
    """Rejects measurements that the arm cannot have produced."""

    q_max: Numbers | None = same_field(MeasurementGate, "q_max", default=None, source="1.5 times the arm's limits")
    speed: Numbers | None = same_field(MeasurementGate, "speed", default=None, source="4 times the arm's limits")
    acceleration: Numbers | None = same_field(
        MeasurementGate, "acceleration", default=None, source="4 times the torque over the inertia"
    )
    spread: Numbers | None = same_field(
        MeasurementGate, "spread", default=None, source="10 standard deviations of the sensor, and its jitter"
    )
    patience: float = same_field(MeasurementGate, "patience")

    def build(self, arm: AbstractRobot, sampling: Sampling) -> MeasurementGate:
        """Build the gate for the nominal arm."""
        gate = MeasurementGate.of_arm(
            arm, torque=sampling.rated, mass=sampling.mass, limited=sampling.limited, **self.parameters()
        )
        if self.spread is not None:
            return gate
        spread = 10.0 * jnp.sqrt(sampling.variance) + sampling.jitter * sampling.period * gate.speed
        return replace(gate, spread=spread)


class JointLearningDescription(AbstractDescription):
    """Learns each joint's rotor inertia and Coulomb friction while the arm moves."""

    kind: Literal["joint_learning"] = "joint_learning"
    rotor: Numbers | None = same_field(
        JointLearning, "rotor", default=None, source="the nominal arm's, or .002 kg m² per N m of rated torque"
    )
    rotor_min: Numbers | None = same_field(JointLearning, "rotor_min", default=None, source=".0005 kg m² per N m")
    rotor_max: Numbers | None = same_field(JointLearning, "rotor_max", default=None, source=".1 kg m² per N m")
    coulomb: Numbers = same_field(JointLearning, "coulomb")
    coulomb_max: Numbers | None = same_field(
        JointLearning, "coulomb_max", default=None, source=".1 of the rated torque"
    )
    low: float = same_field(JointLearning, "low")
    high: float | None = same_field(
        JointLearning, "high", default=None, source="200, or as low as 120 with coarse encoders"
    )
    gate: Numbers | None = same_field(
        JointLearning, "gate", default=None, source=".2, or three times the encoders' noise"
    )
    coherence: float = same_field(JointLearning, "coherence")
    recent: float = same_field(JointLearning, "recent")
    prior: Numbers = same_field(JointLearning, "prior")
    window: Numbers = same_field(JointLearning, "window")
    coulomb_prior: Numbers = same_field(JointLearning, "coulomb_prior")
    coulomb_window: Numbers = same_field(JointLearning, "coulomb_window")

    def build(self, sampling: Sampling) -> AbstractAdaptation:
        """Build the adaptation."""
        return JointLearning.of_arm(
            sampling.mass,
            rotors=sampling.rotors,
            torque=sampling.rated,
            deviation=np.sqrt(np.asarray(sampling.variance)),
            period=sampling.period,
            **self.parameters(),
        )


if TYPE_CHECKING:
    AdaptationDescription = PartDescription | JointLearningDescription
    EstimatorDescription = PartDescription
    RecoveryDescription = PartDescription
    MonitorDescription = PartDescription
else:
    RecoveryDescription = plain_of(Recovery, "RecoveryDescription")
    MonitorDescription = plain_of(Monitor, "MonitorDescription")
    EstimatorDescription = union_of(AbstractEstimator, MeasuredDescription, KalmanDescription)
    AdaptationDescription = union_of(AbstractAdaptation, JointLearningDescription)


class SampledDataDescription(AbstractDescription):
    """The sampled-data form of a scheme; its defaults fit the sensor and the actuator."""

    horizon: float | None = input_field(
        "H, how far a step plans, at least a period",
        "s",
        "> 0",
        default=None,
        source="12 ms, or two periods or 1.5 (delay + 1) periods, if that is more",
    )
    estimator: EstimatorDescription | None = None
    """Estimator of the state and the disturbance; by default `measured`, with gains from the horizon, or `kalman` for
    encoders without a velocity sensor."""
    adaptation: AdaptationDescription | None = JointLearningDescription()
    """Adaptation of the arm's parameters during the motion; null for none."""
    delay: float | None = input_field(
        "age of a measurement when its torque sets in, as the law believes it",
        "periods",
        "[0, 100]",
        default=None,
        source="as the sensor and the actuator say",
    )
    recovery: RecoveryDescription | None = RecoveryDescription()
    """Recovery outside the envelope; null: pull back to the prescribed envelope."""
    monitor: MonitorDescription | None = None
    """Guarantee monitor, which checks at every sample if the guarantee still holds; null for none."""
    gate: GateDescription = GateDescription()
    """Measurement gate, which rejects measurements that the arm cannot have produced."""
    slopes: bool = True
    """True if the robust torque counts the slope part of tau1, as printed in (45)."""
    midpoint: bool = False
    """True to evaluate the arm's model in the middle of the torque's period, and to predict by the planned
    accelerations."""
    viscous_feedforward: bool = False
    """True to compensate the nominal arm's viscous friction at the reference's velocity."""

    @field_validator("adaptation", mode="before")
    @classmethod
    def _learns(cls, value: Any) -> Any:
        """Add the default kind."""
        return {"kind": "joint_learning", **value} if isinstance(value, dict) else value

    def build(self, law: AbstractController, sampling: Sampling) -> AbstractController:
        """Build the sampled-data form of a law.

        Raises DefinitionError if the law has no such form.
        """
        adaptation: AbstractAdaptation | None = None
        if self.adaptation is not None:
            with locate_errors("adaptation"):
                self.adaptation.require_joints(sampling.mass.shape[0])
                if isinstance(self.adaptation, JointLearningDescription):
                    adaptation = self.adaptation.build(sampling)
                else:
                    adaptation = self.adaptation.build()
                # The estimator starts with the estimated inertia, and is slow enough to tolerate its errors.
                variance = jnp.maximum(sampling.variance, FINEST**2 / 12.0)
                sampling = replace(sampling, mass=adaptation.mass_at_start(sampling.mass), variance=variance)
        if self.delay is not None:
            sampling = replace(sampling, delay=self.delay, dead_time=min(sampling.dead_time, self.delay))
        estimator: AbstractEstimator | None = None
        with locate_errors("estimator"):
            if self.estimator is not None:
                self.estimator.require_joints(sampling.mass.shape[0])
                how = (sampling,) if isinstance(self.estimator, MeasuredDescription | KalmanDescription) else ()
                estimator = self.estimator.build(*how)
            elif not sampling.has_velocity:
                estimator = KalmanDescription(kind="kalman").build(sampling)
        recovery = None
        if self.recovery is not None:
            with locate_errors("recovery"):
                recovery = self.recovery.build()
        monitor = None
        if self.monitor is not None:
            with locate_errors("monitor"):
                monitor = self.monitor.build()
        if self.viscous_feedforward and not np.any(np.asarray(getattr(_nominal(law), "viscous", 1.0))):
            raise DefinitionError(
                "the nominal arm has no viscous friction to compensate: set `robot.nominal.viscous`",
                where="viscous_feedforward",
            )
        with locate_errors("gate"):
            self.gate.require_joints(sampling.mass.shape[0])
            gate = self.gate.build(_nominal(law), sampling)
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
            adaptation=adaptation,
            monitor=monitor,
            gate=gate,
            midpoint=self.midpoint,
            viscous_feedforward=self.viscous_feedforward,
        )


def _nominal(law: AbstractController) -> AbstractRobot:
    """The nominal arm of a law."""
    nominal = getattr(law, "nominal", None)
    if not isinstance(nominal, AbstractRobot):
        raise DefinitionError(f"`{type(law).__name__}` has no `nominal` robot, which its sampled-data form needs")
    return nominal
