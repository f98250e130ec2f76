"""The sampled-data form of a scheme in a scenario file: the law for a fixed sample time, with an estimator."""

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
from slidax.law.arm_learning import ArmLearning
from slidax.law.calm_step import Calm
from slidax.law.controllers import AbstractController
from slidax.law.estimators import AbstractEstimator, Measured
from slidax.law.joint_learning import JointLearning
from slidax.law.kalman import FASTEST_PACE, TORQUE_DENSITY, Kalman, StrongTracking
from slidax.law.sampled.gate import MeasurementGate
from slidax.law.sampled.monitor import Monitor
from slidax.law.sampled.recipe import sampled_data
from slidax.law.steps import Recovery
from slidax.plant.actuators import TorqueLimits

from .descriptions import AbstractDescription, Numbers, PartDescription, input_field, plain_of, same_field, union_of

FINEST = 2e-6
"""rad: finest encoder resolution that a Kalman filter with an adaptation assumes. A finer one would make the filter
faster, and a faster filter tolerates only smaller errors of the inertia (docs/learning.md)."""

ARM_GROWTH = 1.5
"""Largest factor by which the estimator's bandwidth grows with `arm_learning` (docs/arm-learning.md)."""


@dataclass(frozen=True)
class Sampling:
    """Sensors, drives and sample time of an arm, as the sampled-data form of its law needs them.

    - `period`: time between samples [s].
    - `delay`: delay from a measurement to the torque based on it [periods].
    - `dead_time`: part of this delay between the command and its torque [periods].
    - `limits`: limits of torque and torque rate.
    - `variance`: variance of a measured position, a number or [n], rad² or m².
    - `has_velocity`: True if velocities are measured.
    - `mass`: inertia matrix of the nominal arm at the start [n n].
    - `rotors`: rotor inertias of the nominal arm [n], kg m² or kg; None if its model has no rotors.
    - `rated`: rated torques of the joints [n], N m or N; infinite if unknown.
    - `limited`: False if the arm may move beyond its position limits.
    - `jitter`: width of the delay's random variation [periods].
    - `growth`: default of the largest factor by which the estimator's bandwidth may grow; 1 for none.
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
    growth: float = 1.0


class MeasuredDescription(AbstractDescription):
    """Uses positions and velocities as measured, and estimates the disturbance from the velocities."""

    kind: Literal["measured"]
    gain: Numbers | None = same_field(
        Measured, "gain", default=None, source="1/6, or 0.3 with a delay of more than one period"
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
    """Estimates velocities and disturbance from positions, by a steady-state Kalman filter."""

    kind: Literal["kalman"]
    torque_density: Numbers = input_field(
        "density of the white noise that drives the disturbance torque",
        "(N m/s)² s",
        default=TORQUE_DENSITY,
        source="docs/loop-rate.md",
    )
    acceleration_density: float | None = input_field(
        "density of the white noise that drives the disturbance acceleration, instead of `torque_density`: equal gains "
        "for all joints",
        "(rad/s³)² s or (m/s³)² s",
        "> 0",
        default=None,
    )
    variance: Numbers | None = input_field(
        "variance of a measured position", "rad² or m²", default=None, source="the sensor's resolution and noise"
    )

    growth: float | None = same_field(
        StrongTracking, "growth", default=None, source="1.5 with `arm_learning`, otherwise 1, no growth"
    )

    def build(self, sampling: Sampling) -> AbstractEstimator:
        """Build the estimator."""
        variance = sampling.variance if self.variance is None else as_array(self.variance)
        if self.acceleration_density is not None:
            for name in ("torque_density", "growth"):
                if name in self.model_fields_set:
                    raise DefinitionError(f"`acceleration_density` and `{name}` both set the gains: leave one out")
            return Kalman.steady(density=self.acceleration_density, variance=variance, period=sampling.period)
        kalman = Kalman.of_arm(
            sampling.mass,
            variance=variance,
            period=sampling.period,
            torque_density=self.torque_density,
            fastest=FASTEST_PACE if self.variance is None else None,
        )
        growth = sampling.growth if self.growth is None else self.growth
        if growth == 1.0:
            return kalman
        deviation = jnp.broadcast_to(jnp.sqrt(variance), sampling.mass.shape[:1])
        return StrongTracking(kalman, deviation, jnp.asarray(growth))


class GateDescription(AbstractDescription):
    """Rejects measurements that the arm cannot have produced."""

    q_max: Numbers | None = same_field(MeasurementGate, "q_max", default=None, source="1.5 times the arm's limits")
    speed: Numbers | None = same_field(MeasurementGate, "speed", default=None, source="4 times the arm's limits")
    acceleration: Numbers | None = same_field(
        MeasurementGate, "acceleration", default=None, source="4 times the rated torque over the inertia"
    )
    spread: Numbers | None = same_field(
        MeasurementGate,
        "spread",
        default=None,
        source="10 standard deviations of the sensor, plus its jitter times `speed`",
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
    """Learns the rotor inertia and Coulomb friction of each joint while the arm moves."""

    kind: Literal["joint_learning"] = "joint_learning"
    """Kind of the part."""
    rotor: Numbers | None = same_field(
        JointLearning, "rotor", default=None, source="the nominal arm's, or 0.002 kg m² per N m of rated torque"
    )
    rotor_min: Numbers | None = same_field(JointLearning, "rotor_min", default=None, source="0.0005 kg m² per N m")
    rotor_max: Numbers | None = same_field(JointLearning, "rotor_max", default=None, source="0.1 kg m² per N m")
    coulomb: Numbers = same_field(JointLearning, "coulomb")
    coulomb_max: Numbers | None = same_field(
        JointLearning, "coulomb_max", default=None, source="0.1 times the rated torque"
    )
    low: float = same_field(JointLearning, "low")
    high: float | None = same_field(
        JointLearning, "high", default=None, source="200, or down to 120 with coarse encoders"
    )
    gate: Numbers | None = same_field(
        JointLearning, "gate", default=None, source="0.2, or three times the encoders' noise"
    )
    coherence: float = same_field(JointLearning, "coherence")
    recent: float = same_field(JointLearning, "recent")
    prior: Numbers = same_field(JointLearning, "prior")
    window: Numbers = same_field(JointLearning, "window")
    coulomb_prior: Numbers = same_field(JointLearning, "coulomb_prior")
    coulomb_window: Numbers = same_field(JointLearning, "coulomb_window")

    def build(self, sampling: Sampling) -> JointLearning:
        """Build the adaptation."""
        return JointLearning.of_arm(
            sampling.mass,
            rotors=sampling.rotors,
            torque=sampling.rated,
            deviation=np.sqrt(np.asarray(sampling.variance)),
            period=sampling.period,
            **self.parameters(),
        )


class ArmLearningDescription(AbstractDescription):
    """Learns payload, link masses, friction and rotors of the whole arm while it moves."""

    kind: Literal["arm_learning"]
    joints: JointLearningDescription = JointLearningDescription()
    """Learning of each joint on its own, used while the learnt model of the arm is not in use."""
    noise: Numbers | None = same_field(
        ArmLearning, "noise", default=None, source="0.02, or more by the encoders' noise"
    )
    mass: float = same_field(ArmLearning, "mass")
    moment: float = same_field(ArmLearning, "moment")
    inertia: float = same_field(ArmLearning, "inertia")
    factor: Numbers = same_field(ArmLearning, "factor")
    viscous: Numbers = same_field(ArmLearning, "viscous")
    coulomb: Numbers = same_field(ArmLearning, "coulomb")
    rotor: Numbers = same_field(ArmLearning, "rotor")
    stribeck: Numbers | None = same_field(ArmLearning, "stribeck")
    ripple: Numbers | None = same_field(ArmLearning, "ripple")

    def build(self, sampling: Sampling) -> AbstractAdaptation:
        """Build the adaptation."""
        own = {name: value for name, value in self.parameters().items() if name != "joints"}
        deviation = np.sqrt(np.asarray(sampling.variance))
        return ArmLearning.of_arm(
            self.joints.build(sampling),
            inertia_matrix=sampling.mass,
            deviation=deviation,
            period=sampling.period,
            **own,
        )


if TYPE_CHECKING:
    AdaptationDescription = PartDescription | JointLearningDescription | ArmLearningDescription
    EstimatorDescription = PartDescription
    CalmDescription = PartDescription
    RecoveryDescription = PartDescription
    MonitorDescription = PartDescription
else:
    CalmDescription = plain_of(Calm, "CalmDescription")
    RecoveryDescription = plain_of(Recovery, "RecoveryDescription")
    MonitorDescription = plain_of(Monitor, "MonitorDescription")
    EstimatorDescription = union_of(AbstractEstimator, MeasuredDescription, KalmanDescription)
    AdaptationDescription = union_of(AbstractAdaptation, JointLearningDescription, ArmLearningDescription)


class SampledDataDescription(AbstractDescription):
    """The form of a scheme for a fixed sample time, with an estimator and limits; defaults fit sensor and actuator."""

    horizon: float | None = input_field(
        "H, planning horizon of a step, at least a period",
        "s",
        "> 0",
        default=None,
        source="12 ms, two periods or 1.5 (delay + 1) periods, whichever is longest",
    )
    estimator: EstimatorDescription | None = None
    """Estimator of the state and the disturbance; by default `measured`, with gains from delay and horizon, or `kalman`
    for encoders without a velocity sensor."""
    adaptation: AdaptationDescription | None = JointLearningDescription()
    """Adaptation of the arm's parameters during the motion; null for none."""
    delay: float | None = input_field(
        "delay from a measurement to the torque based on it, as assumed by the law",
        "periods",
        "[0, 100]",
        default=None,
        source="the sensor's delay plus the actuator's dead time",
    )
    delay_at_most: float | None = input_field(
        "largest delay that can be set while the law runs, by its parameter `actual_delay`",
        "periods",
        "[0, 20]",
        default=None,
        source="a fixed delay",
    )
    recovery: RecoveryDescription | None = RecoveryDescription()
    """Recovery outside the envelope, in a wider envelope that narrows into the prescribed one; null for none."""
    calm: CalmDescription | None = None
    """Calm steps: least torque changes while the error is well inside its envelope; true: the defaults, null: none."""
    monitor: MonitorDescription | None = None
    """Guarantee monitor, which checks at every sample that the guarantee still holds; null for none."""
    gate: GateDescription = GateDescription()
    """Measurement gate, which rejects measurements that the arm cannot have produced."""
    slopes: bool = True
    """True to include the acceleration that keeps the sliding variable s constant in the torque τ0 + τ1, from which the
    paper's eq. (45) computes the size u of the robust torque; false leaves it out, so that u is smaller."""
    midpoint: bool = False
    """True to evaluate the arm's model in the middle of the period in which the torque acts, not at its start, and to
    predict the state over the delay by the planned accelerations."""
    viscous_feedforward: bool = False
    """True to compensate the nominal arm's viscous friction at the reference's velocity."""

    @field_validator("adaptation", mode="before")
    @classmethod
    def _learns(cls, value: Any) -> Any:
        """Add the default kind."""
        return {"kind": "joint_learning", **value} if isinstance(value, dict) else value

    @field_validator("calm", mode="before")
    @classmethod
    def _is_calm(cls, value: Any) -> Any:
        """Replace true by the defaults, and false by null."""
        return {True: {}, False: None}[value] if isinstance(value, bool) else value

    def build(self, law: AbstractController, sampling: Sampling) -> AbstractController:
        """Build the sampled-data form of a law.

        - `law`: the law in continuous time, with its nominal arm.

        Raises DefinitionError if the law has no such form.
        """
        adaptation: AbstractAdaptation | None = None
        if self.adaptation is not None:
            with locate_errors("adaptation"):
                self.adaptation.require_joints(sampling.mass.shape[0])
                if isinstance(self.adaptation, JointLearningDescription | ArmLearningDescription):
                    adaptation = self.adaptation.build(sampling)
                    if isinstance(self.adaptation, ArmLearningDescription):
                        sampling = replace(sampling, growth=ARM_GROWTH)
                else:
                    adaptation = self.adaptation.build()
                # The estimator starts with the learnt inertia, and is slow enough to tolerate its errors.
                variance = jnp.maximum(sampling.variance, FINEST**2 / 12.0)
                sampling = replace(sampling, mass=adaptation.mass_at_start(sampling.mass), variance=variance)
        if self.delay is not None:
            sampling = replace(sampling, delay=self.delay, dead_time=min(sampling.dead_time, self.delay))
        delay = sampling.delay
        if self.delay_at_most is not None:
            if self.delay_at_most < delay:
                raise DefinitionError(
                    f"must be at least the delay, {delay:g} periods; got {self.delay_at_most:g}", where="delay_at_most"
                )
            sampling = replace(sampling, delay=self.delay_at_most)
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
        calm = None
        if self.calm is not None:
            with locate_errors("calm"):
                calm = self.calm.build()
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
            delay=delay,
            delay_at_most=self.delay_at_most,
            dead_time=sampling.dead_time,
            slopes=self.slopes,
            calm=calm,
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
