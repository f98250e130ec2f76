"""Sensors, actuators, disturbances, surroundings and the tolerance band in a scenario file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from pydantic import Field

from slidax.arms.arm import AbstractRobot, JointLimits
from slidax.core.errors import DefinitionError, as_array, is_traced, locate_errors, require_joints, static_value
from slidax.law.controllers import AbstractController
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.sampled.controller import SampledData
from slidax.plant.actuators import Actuator, ActuatorMap, TorqueLimits
from slidax.plant.disturbances import AbstractDisturbance, Sum
from slidax.plant.noise import as_integer
from slidax.plant.sensors import AbstractSensor, Delayed, DifferencedEncoders, Encoders, Exact, Lossy
from slidax.plant.timing import TRACES
from slidax.plant.transmissions import Elasticity, LuGre, Transmission
from slidax.simulation.plant import Table

from .descriptions import AbstractDescription, Numbers, PartDescription, input_field, plain_of, same_field, union_of

if TYPE_CHECKING:
    InstrumentDescription = PartDescription
else:
    InstrumentDescription = union_of(AbstractSensor)

OF_ENCODERS = ("resolution", "position_noise", "velocity", "velocity_noise", "cutoff")
"""Fields of the encoders, which exclude `instrument`."""


class OutageDescription(AbstractDescription):
    """Consecutive lost samples."""

    start: float = input_field("time of the first lost sample", "s", ">= 0")
    samples: int = input_field("number of lost samples", "", "[0, 1e9]")


class LossDescription(AbstractDescription):
    """Lost samples, during which the last torque is held."""

    probability: float = same_field(Lossy, "probability")
    outages: tuple[OutageDescription, ...] = ()
    """Outages, in which all samples are lost."""
    trace: Literal["uneven", "stalls", "skips", "overruns"] | None = None
    """Pattern of lost samples, named as in `slidax.plant.TRACES`: from periods that users of ros2_control reported."""


class SensorDescription(AbstractDescription):
    """Measurement of the state."""

    resolution: Numbers = same_field(Encoders, "resolution", default=0.0)
    position_noise: Numbers = same_field(Encoders, "position_noise")
    velocity: Literal["measured", "differenced"] = "measured"
    """`measured` by a velocity sensor, or `differenced` from the encoders."""
    velocity_noise: Numbers = same_field(Encoders, "velocity_noise")
    cutoff: Numbers = same_field(DifferencedEncoders, "cutoff", default=600.0)
    instrument: InstrumentDescription | None = None
    """Another sensor, selected by its kind; it replaces the encoders that the fields above describe."""
    delay: float = input_field("delay of a measurement, may be fractional", "periods", "[0, 100]", default=0.0)
    jitter: float = input_field("width of the delay's random variation", "periods", "[0, 100]", default=0.0)
    loss: LossDescription = LossDescription()
    """Lost samples."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Seed of the noise."""

    def build(self, period: float, joints: int) -> AbstractSensor | None:
        """Build the sensor; return None if it is ideal.

        - `period`: time between samples [s].
        - `joints`: number of joints.

        Raises DefinitionError if a list has the wrong length, or a number is out of range.
        """
        self.require_joints(joints)
        resolution, position_noise = as_array(self.resolution), as_array(self.position_noise)
        velocity_noise = as_array(self.velocity_noise)
        # In a study the seed may be an array.
        seed = self.seed if isinstance(self.seed, jax.Array) else jax.device_put(np.asarray(self.seed))
        sensor: AbstractSensor = Exact()
        if self.instrument is not None:
            both = [name for name in OF_ENCODERS if name in self.model_fields_set]
            if both:
                raise DefinitionError(
                    "describes encoders, and `instrument` another sensor; leave one out", where=both[0]
                )
            with locate_errors("instrument"):
                self.instrument.require_joints(joints)
                sensor = self.instrument.build()
        elif self.velocity == "differenced":
            if static_value(velocity_noise).any():
                message = "belongs to a velocity sensor, which `velocity: differenced` does not have; leave it out"
                raise DefinitionError(f"{message}; got {self.velocity_noise}", where="velocity_noise")
            sensor = DifferencedEncoders(resolution, position_noise, as_array(self.cutoff), seed)
        elif any(is_traced(x) or static_value(x).any() for x in (resolution, position_noise, velocity_noise)):
            sensor = Encoders(resolution, position_noise, velocity_noise, seed)
        if self.delay or self.jitter:
            sensor = Delayed(sensor, self.delay, self.jitter, seed)
        if self.loss.probability or self.loss.outages or self.loss.trace:
            with locate_errors("loss"):
                # Bounded, since an outage may start after the end of any run.
                starts = [round(min(outage.start / period, 2.0**53)) for outage in self.loss.outages]
                counts = [outage.samples for outage in self.loss.outages]
                first, count = (jax.device_put(np.asarray(numbers, int)) for numbers in (starts, counts))
                pattern = as_integer(TRACES[self.loss.trace].lost().astype(int) if self.loss.trace else ())
                sensor = Lossy(sensor, as_array(self.loss.probability), first, count, seed, pattern)
        return None if isinstance(sensor, Exact) else sensor

    @property
    def has_velocity(self) -> bool:
        """True if velocities are measured and not computed from positions."""
        other = self.instrument
        return self.velocity == "measured" if other is None else not issubclass(other.part, DifferencedEncoders)

    def variance(self) -> Array:
        """Return the variance of a measured position, a number or [n], rad² or m²."""
        sensor = self if self.instrument is None else self.instrument
        rounding, noise = (as_array(getattr(sensor, name, 0.0)) for name in ("resolution", "position_noise"))
        return _variance(rounding, noise)


class ActuatorDescription(AbstractDescription):
    """Drives, which deliver a commanded torque."""

    may_be_infinite = frozenset({"torque", "rate"})

    torque: Numbers | Literal["robot"] | None = input_field(
        "torque limit; `robot`: from the arm's data sheet", "N m or N", default=None, source="no limit"
    )
    rate: Numbers | Literal["robot"] | None = input_field(
        "torque rate limit; `robot`: from the arm's data sheet", "N m/s or N/s", default=None, source="no limit"
    )
    map: list[list[float]] | None = input_field(
        "G of τ = G c, from commands c to joint torques τ, as the law knows it: a row for each joint; `slidax identify "
        "--actuator-map` writes it",
        "",
        default=None,
        source="torques equal commands",
    )
    true_map: list[list[float]] | None = input_field(
        "G of the true drives, if it differs from `map`", "", default=None, source="`map`"
    )
    time_constant: Numbers = same_field(Actuator, "time_constant")
    dead_time: float = input_field(
        "dead time between a command and its torque, may be fractional", "periods", "[0, 100]", default=0.0
    )

    def of_robot(self, limits: JointLimits | None) -> ActuatorDescription:
        """Return the description, in which the arm's own limits replace the value `robot` of `torque` and `rate`.

        - `limits`: limits from the arm's data sheet; None without one.

        Raises DefinitionError if the robot has no such limits.
        """
        numeric = {}
        for field, name in (("torque", "torque"), ("rate", "torque_rate")):
            if getattr(self, field) != "robot":
                continue
            numbers = None if limits is None else static_value(getattr(limits, name))
            if numbers is None or not np.isfinite(numbers).all():
                write = {"torque": "`torque: 50`", "rate": "`rate: 1000` [N m/s]"}[field]
                raise DefinitionError(
                    f"the robot's description has no {name.replace('_', ' ')} limits; write numbers, such as {write}, "
                    "or leave it out",
                    where=field,
                )
            numeric[field] = numbers.tolist()
        return self.model_copy(update=numeric)

    def limits(self) -> TorqueLimits:
        """Return the numeric limits of torque and torque rate."""
        limits = {"torque": self.torque, "rate": self.rate}
        return TorqueLimits(**{name: as_array(value) for name, value in limits.items() if value is not None})

    def known_map(self, joints: int) -> ActuatorMap | None:
        """Return the map from drive commands to joint torques that the law knows; None without `map`, for equal ones.

        Raises DefinitionError if the map has another number of joints, or is invalid.
        """
        return self._map("map", joints)

    def known_to(self, law: AbstractController) -> AbstractController:
        """Return the law, which then uses the map `map` from drive commands to joint torques; unchanged without a map.

        Raises DefinitionError if there is a map and the law is not in sampled-data form.
        """
        known = self.known_map(law.joints)
        if known is None:
            return law
        if not isinstance(law, SampledData):
            raise DefinitionError(
                "needs a law that knows its drives: set `scheme.sampled_data`, or write the map as `true_map`",
                where="map",
            )
        return eqx.tree_at(lambda law: law.drives, law, known, is_leaf=lambda leaf: leaf is None)

    def _map(self, field: str, joints: int) -> ActuatorMap | None:
        rows = getattr(self, field)
        if rows is None:
            return None
        if [len(row) for row in rows] != joints * [joints]:
            message = f"must have {joints} rows of {joints} numbers; got rows of {[len(row) for row in rows]}"
            raise DefinitionError(message, where=field)
        with locate_errors(field):
            return ActuatorMap.of(rows)

    def joint_limits(self, joints: int) -> TorqueLimits:
        """Return limits of joint torques and their rates that keep each drive's command within `torque` and `rate`."""
        known = self.known_map(joints)
        return self.limits() if known is None else known.within(self.limits())

    def build(self, joints: int) -> Actuator | None:
        """Build the actuator for a number of `joints`; return None if it is ideal.

        Raises DefinitionError if a list has the wrong length, or a number is out of range.
        """
        self.require_joints(joints)
        true = self._map("map" if self.true_map is None else "true_map", joints)
        perfect = self.torque is None and self.rate is None and not self.dead_time and true is None
        if perfect and not as_array(self.time_constant).any():
            return None
        return Actuator(self.limits(), as_array(self.time_constant), self.dead_time, true)


@jax.jit
def _variance(rounding: Array, noise: Array) -> Array:
    # A Kalman filter needs a positive variance.
    return jnp.maximum(rounding * rounding / 12.0 + noise * noise, 1e-18)


if TYPE_CHECKING:
    Term = PartDescription
else:
    Term = union_of(AbstractDisturbance)


class DisturbanceDescription(AbstractDescription):
    """External disturbance: the sum of the terms, times the scale."""

    scale: float = input_field("factor on all terms; 0 switches the disturbance off", default=1.0)
    terms: tuple[Term, ...] = ()
    """Terms of the sum."""

    def build(self) -> AbstractDisturbance:
        """Build the disturbance."""
        built = []
        for number, term in enumerate(self.terms):
            with locate_errors(f"terms.{number}"):
                built.append(term.build())
        return self.scale * Sum(tuple(built))


if TYPE_CHECKING:
    LuGreDescription = PartDescription
    ElasticityDescription = PartDescription
else:
    LuGreDescription = plain_of(LuGre, "LuGreDescription", doc="LuGre friction of the true joints.")
    ElasticityDescription = plain_of(Elasticity, "ElasticityDescription", doc="A spring between motor and link.")


class TransmissionDescription(AbstractDescription):
    """Friction and elasticity of the true joints, which have additional states; unknown to the law."""

    friction: LuGreDescription | None = None
    """LuGre friction, in addition to the arm's own friction."""
    elasticity: ElasticityDescription | None = None
    """Elasticity of the joints; by default they are rigid."""

    def build(self, joints: int) -> Transmission:
        """Build the transmission.

        Raises DefinitionError if a list has the wrong length, or a number is out of range.
        """
        parts: dict[str, Any] = {}
        for name in ("friction", "elasticity"):
            part = getattr(self, name)
            if part is not None:
                with locate_errors(name):
                    part.require_joints(joints)
                    parts[name] = part.build()
        return Transmission(**parts)


if TYPE_CHECKING:
    ToleranceDescription = PartDescription
else:
    ToleranceDescription = plain_of(
        PrescribedPerformance, "ToleranceDescription", doc="Bounds of the error, with the parameters of an envelope."
    )


def tolerance_of(description: ToleranceDescription | None, robot: AbstractRobot) -> PrescribedPerformance | None:
    """Build the tolerance band for the errors of a robot; return None without a description.

    Raises DefinitionError, with the path of the field, if it is invalid or does not fit the joints.
    """
    if description is None:
        return None
    with locate_errors("tolerance"):
        tolerance: PrescribedPerformance = description.build()
        require_joints(tolerance, robot.joints, type(robot).__name__)
    return tolerance


class TableDescription(AbstractDescription):
    """A horizontal, rigid and infinite surface that the tip and its payload can touch."""

    height: float = same_field(Table, "height")
    friction: float = same_field(Table, "friction")


class SurroundingsDescription(AbstractDescription):
    """Surroundings of the arm, for MuJoCo."""

    table: TableDescription | None = None
    """A table."""

    def build(self) -> Table | None:
        """Build the table; return None without one."""
        return None if self.table is None else Table(as_array(self.table.height), as_array(self.table.friction))
