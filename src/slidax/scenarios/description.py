"""Description of a scenario: the whole file."""

from __future__ import annotations

from functools import partial
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array
from pydantic import Field, ValidationError

from slidax._errors import DefinitionError, as_array, counted, each_of, located, require_joints
from slidax._timing import Timing
from slidax._types import State
from slidax.controllers import AbstractController
from slidax.numerics import runge_kutta_4, semi_implicit_euler
from slidax.robots import Articulated, Coupled, JointLimits
from slidax.simulation import MujocoPlant, Plant, Stepping, Table
from slidax.trajectories import AbstractTrajectory

from .base import AbstractDescription, said, same
from .changes import changed
from .default_bound import default_bound, warn_of_another_arms
from .disturbances import DisturbanceDescription
from .instruments import ActuatorDescription, SensorDescription
from .mistakes import translated
from .robots import RobotDescription
from .sampled_data import Sampling
from .scenario import Scenario
from .schemes import AnyScheme
from .trajectories import TrajectoryDescription, trajectory_of, warn_of_units
from .true_and_nominal import Arms
from .tube import ToleranceDescription, tolerance_of
from .uncertainty.mapping import Uncertainty

OF_THE_LAW = ("scheme", "simulation", "tolerance", "truth", "uncertainty", "title", "source")
"""Blocks that the law always knows, so that `truth` cannot change them."""

TOLD = "write it under the scenario's own key"

INTEGRATORS = {"rk4": runge_kutta_4, "semi_implicit_euler": semi_implicit_euler}


class StartDescription(AbstractDescription):
    """The state at t = 0."""

    q: list[float] = said("positions, one per joint", "rad or m")
    dq: list[float] | None = said("velocities, one per joint", "rad/s or m/s", default=None, source="at rest")

    def build(self, joints: int) -> State:
        """Build the state; raise DefinitionError unless there is one entry for each joint."""
        dq = [0.0] * joints if self.dq is None else self.dq
        for field, values in (("q", self.q), ("dq", dq)):
            if len(values) != joints:
                message = f"must have one entry for {each_of(joints, 'joint')}; got {len(values)}"
                raise DefinitionError(message, where=field)
        return State(q=as_array(self.q), dq=as_array(dq))


class SimulationDescription(AbstractDescription):
    """Time steps of the simulation, and its checks."""

    mode: Literal["continuous", "held"] = "held"
    """`held`: torque held over a period; `continuous`: the law at every stage of the integrator."""
    integrator: Literal["rk4", "semi_implicit_euler"] = "rk4"
    """One step of the plant."""
    period: float = said("time between two samples; in continuous mode the integrator's step", "s", "> 0")
    substeps: int = said("integrator steps per period in held mode", "", "[1, 10000]", default=1)
    t1: float = said("end, a whole number of periods", "s", "> 0")
    log_every: int = said(
        "one in how many samples is written to the log; metrics count all", "", "[1, 1e9]", default=10
    )
    outside: Literal["raise", "recover"] = "raise"
    """At a sample outside the envelope, `raise` ends the run, and `recover` counts the sample and goes on."""
    limits: Literal["check", "ignore"] = "check"
    """`check` refuses a start or a motion beyond the joints' limits, `ignore` runs it."""
    plant: Literal["own", "mujoco"] = "own"
    """The arm's simulator: our own equations, or MuJoCo, in held mode."""
    friction: Literal["smooth", "dry"] = "smooth"
    """Friction of MuJoCo's plant: `smooth` as in ours, or `dry`, with which a joint can stick."""
    engine: Literal["auto", "native", "xla", "cuda"] = "auto"
    """Execution: `native` is our own machine code, `xla` JAX's compiler; `auto` takes the fastest one on the processor;
    `cuda` is the native code on an NVIDIA card, for batches."""


class TableDescription(AbstractDescription):
    """A horizontal, rigid and infinite surface, which the tip and its payload can touch."""

    height: float = same(Table, "height")
    friction: float = same(Table, "friction")


class SurroundingsDescription(AbstractDescription):
    """Surroundings of the arm, for MuJoCo's plant."""

    table: TableDescription | None = None
    """A table."""

    def build(self) -> Table | None:
        """Build the table, if there is one."""
        return None if self.table is None else Table(as_array(self.table.height), as_array(self.table.friction))


def _rated(torque: Array, limits: JointLimits | None, joints: int) -> Array:
    """Rated torques of the joints: from the scenario's drives, else from the arm's data sheet."""
    rated = jnp.broadcast_to(torque, (joints,))
    return rated if limits is None else jnp.where(jnp.isfinite(rated), rated, limits.torque)


class Moving(NamedTuple):
    """A closed loop without its law.

    - `arms`: true and nominal arm.
    - `drive`: drives, with numeric limits.
    - `plant`, `trajectory`, `state0`: as in `simulate`.
    """

    arms: Arms
    drive: ActuatorDescription
    plant: Plant | MujocoPlant
    trajectory: AbstractTrajectory
    state0: State


class ScenarioDescription(AbstractDescription):
    """One closed loop: the arm, its motion, its disturbance, its controller, and how it is simulated."""

    title: str
    """Title of the scenario, in one line."""
    source: str = ""
    """Source of the numbers."""
    robot: RobotDescription
    """The true arm, and the arm that the law knows."""
    trajectory: TrajectoryDescription
    """Desired motion of the joints."""
    disturbance: DisturbanceDescription = DisturbanceDescription()
    """Disturbance of the joints from outside."""
    sensor: SensorDescription = SensorDescription()
    """Measurement of the state; by default exact and without delay."""
    surroundings: SurroundingsDescription = SurroundingsDescription()
    """Surroundings of the arm; by default none."""
    actuator: ActuatorDescription = ActuatorDescription()
    """Drives; by default they deliver each torque exactly and without delay."""
    start: StartDescription
    """The state at t = 0."""
    scheme: AnyScheme
    """The control scheme."""
    simulation: SimulationDescription
    """Time steps of the simulation, and its checks."""
    tolerance: ToleranceDescription | None = None
    """Tolerance band of a run, independent of the scheme's envelope; by default none."""

    truth: dict[str, Any] = Field(default={})
    """True values by path that differ from the file and are unknown to the law, as in one case of a study."""
    uncertainty: Uncertainty = Field(default={})
    """Uncertainty: a set of values by path. Studies draw from it; one run takes the file's own numbers."""

    def build(self, name: str) -> Scenario:
        """Build the scenario with all its parts; its law does not know `truth`.

        Raises DefinitionError, with the path of the field, if a part is invalid.
        """
        nominal = actual = self.moving()
        if self.truth:
            description = self.as_it_is()
            with located("truth"):
                actual = description.moving()
        simulation = self.simulation
        return Scenario(
            name=name,
            robot=self.robot.kind,
            scheme=self.scheme.name,
            description=self,
            plant=actual.plant,
            controller=self.law(nominal),
            trajectory=actual.trajectory,
            state0=actual.state0,
            t1=simulation.t1,
            stepping=Stepping(
                period=simulation.period,
                mode=simulation.mode,
                substeps=simulation.substeps,
                integrator=INTEGRATORS[simulation.integrator],
                outside=simulation.outside,
                limits=simulation.limits,
                engine=simulation.engine,
            ),
            log_every=simulation.log_every,
            tolerance=tolerance_of(self.tolerance, nominal.arms.true),
        )

    def as_it_is(self) -> ScenarioDescription:
        """Return the description with the values of `truth`.

        Raises DefinitionError if one of them is invalid.
        """
        if not self.truth:
            return self
        of_robot = any(path.startswith("robot.") for path in self.truth)
        resolved = self.model_copy(update={"robot": self.robot.resolved()}) if of_robot else self
        data = resolved.model_dump(exclude_unset=True, exclude={"truth", "uncertainty"})
        with located("truth"):
            unseen = [path for path in self.truth if path.split(".")[0] in OF_THE_LAW]
            if unseen:
                message = f"is what the law is told, or how time passes, not what is true: {TOLD}"
                raise DefinitionError(message, where=unseen[0])
            data = changed(data, dict(self.truth))
            try:
                return type(self).model_validate(data)
            except ValidationError as error:
                raise translated(error, data) from None

    @property
    def timing(self) -> Timing:
        """Sample time and delays of the loop."""
        return Timing(self.simulation.period, self.sensor.delay, self.actuator.dead_time)

    def moving(self) -> Moving:
        """Build all parts except the law.

        Raises DefinitionError, with the path of the field, if a part is invalid.
        """
        with located("robot"):
            arms = self.robot.build()
            true = arms.true
        with located("trajectory"):
            trajectory = trajectory_of(self.trajectory, arms.limits, arms.nominal)
            followed = eqx.filter_eval_shape(trajectory.position, jax.ShapeDtypeStruct((), float)).shape
            if followed != (true.joints,):
                raise DefinitionError(f"moves {counted(followed[0], 'joint')}, but the robot has {true.joints}")
            warn_of_units(self.trajectory, trajectory, self.simulation.t1)
        with located("disturbance"):
            disturbance = self.disturbance.build()
            require_joints(disturbance, true.joints, type(true).__name__)
        with located("sensor"):
            sensor = self.sensor.build(self.simulation.period, true.joints)
        with located("actuator"):
            drive = self.actuator.of_robot(arms.limits)
            actuator = drive.build(true.joints)
        with located("start"):
            state0 = self.start.build(true.joints)
        plant = self._plant(Plant(true, disturbance, sensor, actuator, arms.load))
        return Moving(arms, drive, plant, trajectory, state0)

    def law(self, moving: Moving) -> AbstractController:
        """Build the law for a closed loop without its law.

        Raises DefinitionError, with the path of the field, if it is invalid.
        """
        arms, drive, state0 = moving.arms, moving.drive, moving.state0
        true, nominal = arms.true, arms.nominal
        with located("scheme"):
            sampled = self.scheme.sampled_data is not None
            find = partial(default_bound, true, nominal, arms.load, drive.limits(), sampled=sampled)
            scheme = self.scheme.with_bound(find).with_limit(drive.limits().torque)
            bound = getattr(self.scheme, "bound", None)
            if bound is not None and all(value is not None for _, value in bound):
                warn_of_another_arms(dict(bound), state0, drive.limits(), find)
            controller: AbstractController = scheme.build(nominal=nominal)
            if self.scheme.sampled_data is not None:
                sampling = Sampling(
                    period=self.simulation.period,
                    delay=self.timing.total_delay,
                    dead_time=self.timing.dead_time,
                    limits=drive.limits(),
                    variance=self.sensor.variance(),
                    has_velocity=self.sensor.has_velocity,
                    mass=nominal.mass(state0.q),
                    rotors=nominal.armature if isinstance(nominal, Articulated | Coupled) else None,
                    rated=_rated(drive.limits().torque, arms.limits, true.joints),
                    limited=self.simulation.limits == "check",
                    jitter=self.sensor.jitter,
                )
                with located("sampled_data"):
                    controller = self.scheme.sampled_data.build(controller, sampling)
        return controller

    def _plant(self, own: Plant) -> Plant | MujocoPlant:
        with located("surroundings"):
            table = self.surroundings.build()
        if self.simulation.plant == "own":
            remedy = "set `simulation.plant` to `mujoco`"
            if table is not None:
                raise DefinitionError(f"only a plant that MuJoCo moves meets anything: {remedy}", where="surroundings")
            if self.simulation.friction == "dry":
                message = f"only a plant that MuJoCo moves really sticks: {remedy}"
                raise DefinitionError(message, where="simulation.friction")
            return own
        with located("simulation.plant"):
            return MujocoPlant.of(own, surroundings=table, dry=self.simulation.friction == "dry")
