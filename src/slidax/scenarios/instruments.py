"""Sensors and actuators in a scenario file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from pydantic import Field

from slidax._errors import DefinitionError, as_array, is_traced, known, located
from slidax.actuators import Actuator, TorqueLimits
from slidax.robots import JointLimits
from slidax.sensors import AbstractSensor, Delayed, DifferencedEncoders, Encoders, Exact, Lossy

from .base import AbstractDescription, Numbers, said, same
from .derived import PartDescription, union_of

if TYPE_CHECKING:
    InstrumentDescription = PartDescription
else:
    InstrumentDescription = union_of(AbstractSensor)

OF_ENCODERS = ("resolution", "position_noise", "velocity", "velocity_noise", "cutoff")
"""What describes the encoders, where no other instrument is named."""


class OutageDescription(AbstractDescription):
    """Samples that are lost in a row."""

    start: float = said("time of the first", "s", ">= 0")
    samples: int = said("how many", "", "[0, 1e9]")


class LossDescription(AbstractDescription):
    """Samples that do not arrive; the last torque is held."""

    probability: float = same(Lossy, "probability")
    outages: tuple[OutageDescription, ...] = ()
    """Those that are lost for certain."""


class SensorDescription(AbstractDescription):
    """What a law measures of the state."""

    resolution: Numbers = same(Encoders, "resolution", default=0.0)
    position_noise: Numbers = same(Encoders, "position_noise")
    velocity: Literal["measured", "differenced"] = "measured"
    """`measured` by a sensor of its own, or `differenced` from the encoders."""
    velocity_noise: Numbers = same(Encoders, "velocity_noise")
    cutoff: Numbers = same(DifferencedEncoders, "cutoff", default=600.0)
    instrument: InstrumentDescription | None = None
    """Another sensor by its kind, in place of the encoders that the fields above describe."""
    delay: float = said("age of a measurement when it arrives, whole or not", "periods", "[0, 100]", default=0.0)
    jitter: float = said("width of the spread of that age", "periods", "[0, 100]", default=0.0)
    loss: LossDescription = LossDescription()
    """Samples that do not arrive."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Another seed gives other noise."""

    def build(self, period: float, joints: int) -> AbstractSensor | None:
        """The sensor; None if it is perfect.

        - `period`: time between samples [s].
        - `joints`: how many are measured.

        Raises DefinitionError if a list has another length, or a number is out of its range.
        """
        self.require_joints(joints)
        resolution, position_noise = as_array(self.resolution), as_array(self.position_noise)
        velocity_noise = as_array(self.velocity_noise)
        # A seed that varies is an array by then.
        seed = self.seed if isinstance(self.seed, jax.Array) else jax.device_put(np.asarray(self.seed))
        sensor: AbstractSensor = Exact()
        if self.instrument is not None:
            both = [name for name in OF_ENCODERS if name in self.model_fields_set]
            if both:
                raise DefinitionError(
                    "describes encoders, and `instrument` another sensor; leave one out", where=both[0]
                )
            with located("instrument"):
                self.instrument.require_joints(joints)
                sensor = self.instrument.build()
        elif self.velocity == "differenced":
            if known(velocity_noise).any():
                message = "is that of a velocity sensor, which `velocity: differenced` has not; leave it out"
                raise DefinitionError(f"{message}; got {self.velocity_noise}", where="velocity_noise")
            sensor = DifferencedEncoders(resolution, position_noise, as_array(self.cutoff), seed)
        elif any(is_traced(x) or known(x).any() for x in (resolution, position_noise, velocity_noise)):
            sensor = Encoders(resolution, position_noise, velocity_noise, seed)
        if self.delay or self.jitter:
            sensor = Delayed(sensor, self.delay, self.jitter, seed)
        if self.loss.probability or self.loss.outages:
            with located("loss"):
                # What begins after any run is never lost.
                starts = [round(min(outage.start / period, 2.0**53)) for outage in self.loss.outages]
                counts = [outage.samples for outage in self.loss.outages]
                first, count = (jax.device_put(np.asarray(numbers, int)) for numbers in (starts, counts))
                sensor = Lossy(sensor, as_array(self.loss.probability), first, count, seed)
        return None if isinstance(sensor, Exact) else sensor

    @property
    def has_velocity(self) -> bool:
        """Whether velocities are measured, rather than found from positions."""
        other = self.instrument
        return self.velocity == "measured" if other is None else not issubclass(other.part, DifferencedEncoders)

    def variance(self) -> Array:
        """The variance of a measured position, one number or [n], rad² or m²."""
        of = self if self.instrument is None else self.instrument
        rounding, noise = (as_array(getattr(of, name, 0.0)) for name in ("resolution", "position_noise"))
        return _variance(rounding, noise)


class ActuatorDescription(AbstractDescription):
    """How the drives deliver a commanded torque."""

    torque: Numbers | Literal["robot"] | None = said(
        "largest torque; `robot`: as its data sheet says", "N m or N", default=None, source="no limit"
    )
    rate: Numbers | Literal["robot"] | None = said(
        "fastest change of torque; `robot`: as its data sheet says", "N m/s or N/s", default=None, source="no limit"
    )
    time_constant: Numbers = same(Actuator, "time_constant")
    dead_time: float = said("between a command and its torque, whole or not", "periods", "[0, 100]", default=0.0)

    def of_robot(self, limits: JointLimits | None) -> ActuatorDescription:
        """The same with the robot's own limits where they are asked for.

        - `limits`: the robot's, if it has any.

        Raises DefinitionError if it has none.
        """
        found = {}
        for field, name in (("torque", "torque"), ("rate", "torque_rate")):
            if getattr(self, field) != "robot":
                continue
            numbers = None if limits is None else known(getattr(limits, name))
            if numbers is None or not np.isfinite(numbers).all():
                write = {"torque": "`torque: 50`", "rate": "`rate: 1000` [N m/s]"}[field]
                raise DefinitionError(
                    f"the robot's description has no such limit; write numbers, such as {write}, or leave it out",
                    where=field,
                )
            found[field] = numbers.tolist()
        return self.model_copy(update=found)

    def limits(self) -> TorqueLimits:
        """The limits of torque and torque rate, once those of the robot are known."""
        given = {"torque": self.torque, "rate": self.rate}
        return TorqueLimits(**{name: as_array(value) for name, value in given.items() if value is not None})

    def build(self, joints: int) -> Actuator | None:
        """The actuator; None if it is perfect.

        - `joints`: how many are driven.

        Raises DefinitionError if a list has another length, or a number is out of its range.
        """
        self.require_joints(joints)
        perfect = self.torque is None and self.rate is None and not self.dead_time
        if perfect and not as_array(self.time_constant).any():
            return None
        return Actuator(self.limits(), as_array(self.time_constant), self.dead_time)


@jax.jit
def _variance(rounding: Array, noise: Array) -> Array:
    # A filter needs some noise to weigh the model against.
    return jnp.maximum(rounding * rounding / 12.0 + noise * noise, 1e-18)
