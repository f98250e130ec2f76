"""Scenarios: the description in a file, and the closed loop that is built from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array
from pydantic import Field, ValidationError, create_model

from slidax.arms.arm import JointLimits
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.core.errors import (
    DefinitionError,
    as_array,
    count_noun,
    each_of,
    locate_errors,
    nearest_word,
    require_joints,
)
from slidax.core.integrators import runge_kutta_4, semi_implicit_euler
from slidax.core.method_above import MethodAbove
from slidax.core.types import State, Timing
from slidax.law.controllers import AbstractController
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.presets import Preset
from slidax.law.sampled.recipe import class_of_law
from slidax.motions.stream import Streamed
from slidax.motions.trajectory import AbstractMotion
from slidax.simulation.define import require_fitting
from slidax.simulation.plant import MujocoPlant, Plant
from slidax.simulation.run import Run
from slidax.simulation.simulate import Parts, simulate, simulate_batch
from slidax.simulation.stepping import Stepping

from .changes import with_changes
from .default_bound import default_bound, warn_of_implausible_bound
from .descriptions import AbstractDescription, PartDescription, input_field
from .instruments import (
    ActuatorDescription,
    DisturbanceDescription,
    SensorDescription,
    SurroundingsDescription,
    ToleranceDescription,
    TransmissionDescription,
    tolerance_of,
)
from .robots import Arms, RobotDescription
from .sampled_data import Sampling
from .schemes import AnyScheme, described_scheme
from .trajectories import TrajectoryDescription, trajectory_of, warn_of_units
from .uncertainty import Uncertainty
from .yaml_text import validation_error

FROM_FILES = ("urdf", "mjcf", "identified")
"""Kinds of robots that are read from a file, which also has the robot's name."""


# Compared by identity: arrays have no single truth value, and scenarios are keys of compiled batches.
@dataclass(frozen=True, eq=False)
class Scenario:
    """The parts of a closed loop, with the duration and the time steps of its simulation.

    - `name`, `robot`, `scheme`: names of the scenario, its robot and its scheme.
    - `description`: the validated content of the scenario file.
    - `plant`, `controller`, `trajectory`, `state0`: true arm with sensors and drives, law, motion, state at t = 0.
    - `t1`: end of the run [s]. `stepping`: time steps, mode and engine. `log_every`: log interval in samples.
    - `tolerance`: tolerance band of a run, independent of the scheme's envelope; None for none.
    - `changed`: fields that `replace` changed; they may differ from `description`.
    """

    name: str
    robot: str
    scheme: str
    description: ScenarioDescription
    plant: Plant | MujocoPlant
    controller: AbstractController
    trajectory: AbstractMotion
    state0: State
    t1: float
    stepping: Stepping
    log_every: int | None = 1
    tolerance: PrescribedPerformance | None = None
    changed: tuple[str, ...] = ()

    @property
    def period(self) -> float:
        """Time between two samples [s]."""
        return self.stepping.period

    def replace(self, **changes: Any) -> Scenario:
        """Return a copy of the scenario with some fields replaced.

            scenario.replace(state0=State([0.2, 0.8]), t1=2.0, mode="held", period=2e-4)

        - `changes`: new values of fields of the scenario or of its `Stepping`, by name.

        Raises DefinitionError if a field does not exist, or the parts do not fit each other.
        """
        of_stepping = {field.name for field in fields(Stepping)}
        names = {field.name for field in fields(self)} - {"description", "changed"}
        for name in changes:
            if name not in names | of_stepping:
                raise DefinitionError(f"a scenario has no field `{name}`; {nearest_word(name, names | of_stepping)}")
        others = {name: value for name, value in changes.items() if name in names}
        if (law := class_of_law(others.get("controller", self.controller))) is not class_of_law(self.controller):
            others = {"scheme": law.__name__} | others
        steps = {name: value for name, value in changes.items() if name in of_stepping}
        stepping = Stepping.of(others.pop("stepping", self.stepping), steps)
        scenario = replace(self, **others, stepping=stepping, changed=tuple(dict.fromkeys((*self.changed, *changes))))
        require_fitting(*scenario.parts, stepping=stepping)
        return scenario

    def set(self, changes: dict[str, Any]) -> Scenario:
        """Return a copy of the scenario with new values for fields of its file, by dotted path as in `--set`.

            scenario.set({"scheme.surface.k1": 0.4, "start.q[elbow]": 0.3})

        - `changes`: values by path, validated as in a file. `scheme.name` is set first and selects another scheme.

        Raises DefinitionError if a value is invalid, or `replace` was used before: its changes would be lost.
        """
        if self.changed:
            changed = ", ".join(f"`{name}`" for name in self.changed)
            raise DefinitionError(f"`replace` changed {changed}, which `set` would lose: use `set` before `replace`")
        return self.description.changed(changes).build(self.name)

    sweep = MethodAbove("slidax.studies.by_path:sweep")
    grad = MethodAbove("slidax.studies.by_path:grad")
    report = MethodAbove("slidax.report.pages:write_run_report")

    @property
    def arm_name(self) -> str:
        """Name of the arm: from the robot's file, or the robot's kind if it has no file."""
        return getattr(self.plant.robot, "name", self.robot) if self.robot in FROM_FILES else self.robot

    def _facts(self) -> dict[str, str]:
        facts = {
            "arm": f"{self.arm_name}, {count_noun(self.controller.joints, 'joint')}",
            "controller": f"{self.scheme}, every {1e3 * self.period:g} ms",
            "duration": f"{self.t1:g} s",
            "uncertainty": ", ".join(self.description.uncertainty) or "none",
        }
        if isinstance(self.trajectory, Streamed):
            facts["reference"] = self.trajectory.summary
        return facts | ({"replaced": ", ".join(self.changed)} if self.changed else {})

    def __repr__(self) -> str:
        lines = [f"  {name:<12} {fact}" for name, fact in self._facts().items()]
        return "\n".join([f"Scenario `{self.name}`: {self.description.title}", *lines])

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
        rows = "".join(f"<tr><th>{name}</th><td>{escape(fact)}</td></tr>" for name, fact in self._facts().items())
        return f"<b>{escape(self.description.title)}</b> <code>{escape(self.name)}</code><table>{rows}</table>"

    @property
    def parts(self) -> Parts:
        """Plant, controller, trajectory, start, and the tolerance band if any, in the order of `simulate`."""
        parts = self.plant, self.controller, self.trajectory, self.state0
        return parts if self.tolerance is None else (*parts, self.tolerance)

    def simulate(self, *, log_every: int | None = 0, throw: bool = False, progress: bool | None = None) -> Run:
        """Simulate the scenario.

        - `log_every`: log interval in samples; None: no log; 0: the scenario's own interval.
        - `throw`: True to raise OutcomeError if the run leaves its envelope or becomes infinite.
        - `progress`: True for a progress bar on the terminal; None shows it for long runs.

        Raises DefinitionError if the parts do not fit each other.
        """
        every = self.log_every if log_every == 0 else log_every
        return simulate(
            *self.parts, t1=self.t1, stepping=self.stepping, log_every=every, throw=throw, progress=progress
        )

    def simulate_batch(
        self,
        define: Callable[[Scenario, Any], Scenario],
        varied: Any,
        *,
        log_every: int | None = None,
        threads: int | None = None,
    ) -> Run:
        """Simulate a batch of variants of the scenario, as one `Run`.

            scenario.simulate_batch(lambda scenario, q: scenario.replace(state0=State(q)), starts)

        - `define`: maps this scenario and the varied values of a run to the scenario of that run, by `replace`.
        - `varied`: a pytree of arrays; their first axis is the run.
        - `log_every`: log interval in samples, None for no log. `threads`: CPU threads, None for one per core.

        Raises DefinitionError if the parts do not fit each other, or `define` changes `t1` or the stepping.
        """
        parts = _PartsOfRun(self, define)
        return simulate_batch(parts, varied, t1=self.t1, stepping=self.stepping, log_every=log_every, threads=threads)


@dataclass(frozen=True)
class _PartsOfRun:
    """Function from the varied values of a run to its `Parts`; equal instances share compiled code."""

    scenario: Scenario
    define: Callable[[Scenario, Any], Scenario]

    def __call__(self, varied: Any) -> Parts:
        scenario = self.define(self.scenario, varied)
        if (scenario.t1, scenario.stepping) != (self.scenario.t1, self.scenario.stepping):
            raise DefinitionError(
                "all runs of a batch must have the same `t1` and stepping: change them before `simulate_batch`"
            )
        return scenario.parts


OF_THE_LAW = ("scheme", "simulation", "tolerance", "truth", "uncertainty", "title", "source")
"""Blocks that the law always knows, so that `truth` cannot change them."""

KNOWN_TO_LAW_REMEDY = "set the scenario's own field instead"

INTEGRATORS = {"rk4": runge_kutta_4, "semi_implicit_euler": semi_implicit_euler}


class StartDescription(AbstractDescription):
    """The state at t = 0."""

    q: list[float] = input_field("positions, one per joint", "rad or m")
    dq: list[float] | None = input_field("velocities, one per joint", "rad/s or m/s", default=None, source="at rest")

    def build(self, joints: int) -> State:
        """Build the state.

        Raises DefinitionError unless there is an entry for each joint.
        """
        dq = [0.0] * joints if self.dq is None else self.dq
        for field, values in (("q", self.q), ("dq", dq)):
            if len(values) != joints:
                message = f"must have one entry for {each_of(joints, 'joint')}; got {len(values)}"
                raise DefinitionError(message, where=field)
        return State(q=as_array(self.q), dq=as_array(dq))


class SimulationDescription(AbstractDescription):
    """Time steps of the simulation, and its checks."""

    mode: Literal["continuous", "held"] = "held"
    """`held`: a torque per period, held until the next; `continuous`: a torque at every stage of the integrator."""
    integrator: Literal["rk4", "semi_implicit_euler"] = "rk4"
    """Integrator of the plant."""
    period: float = input_field("time between two samples; in continuous mode the integrator's step", "s", "> 0")
    substeps: int = input_field("integrator steps per period in held mode", "", "[1, 10000]", default=1)
    t1: float = input_field("end of the run, a whole number of periods", "s", "> 0")
    log_every: int = input_field("log interval in samples; metrics use all samples", "", "[1, 1e9]", default=10)
    outside: Literal["raise", "recover"] = "raise"
    """At a sample outside the envelope, `raise` ends the run; `recover` counts the sample and continues."""
    limits: Literal["check", "ignore"] = "check"
    """`check` refuses a start or a motion beyond the joint limits; `ignore` runs it."""
    plant: Literal["own", "mujoco"] = "own"
    """Simulator of the arm: `own` for slidax's equations, or `mujoco` (only in held mode)."""
    friction: Literal["smooth", "dry"] = "smooth"
    """Friction in MuJoCo: `smooth` as in slidax's own simulator, or `dry`, with which a joint can stick."""
    engine: Literal["auto", "native", "xla", "cuda"] = "auto"
    """Engine: `native` for slidax's own machine code, `xla` for JAX's compiler, `auto` for `native` if possible and
    otherwise `xla`, `cuda` for slidax's own code on an NVIDIA GPU, only for batches."""


def _rated(torque: Array, limits: JointLimits | None, joints: int) -> Array:
    """Rated torques of the joints: from the scenario's drives if finite, otherwise from the arm's data sheet."""
    rated = jnp.broadcast_to(torque, (joints,))
    return rated if limits is None else jnp.where(jnp.isfinite(rated), rated, limits.torque)


class OpenLoop(NamedTuple):
    """The parts of a closed loop without its law.

    - `arms`: true and nominal arm.
    - `drive`: description of the drives; a torque or rate limit given as `robot` is replaced by the arm's own limit.
    - `plant`, `trajectory`, `state0`: as in `simulate`.
    """

    arms: Arms
    drive: ActuatorDescription
    plant: Plant | MujocoPlant
    trajectory: AbstractMotion
    state0: State


class ScenarioDescription(AbstractDescription):
    """A closed loop: the arm, its motion, its disturbance, its controller, and its simulation."""

    title: str
    """Title of the scenario, in one line."""
    source: str = ""
    """Source of the numbers."""
    robot: RobotDescription
    """The true arm, and the arm that the law knows."""
    trajectory: TrajectoryDescription
    """Desired motion of the joints."""
    disturbance: DisturbanceDescription = DisturbanceDescription()
    """External disturbance of the joints."""
    sensor: SensorDescription = SensorDescription()
    """Measurement of the state; by default exact and without delay."""
    surroundings: SurroundingsDescription = SurroundingsDescription()
    """Surroundings of the arm; by default none."""
    actuator: ActuatorDescription = ActuatorDescription()
    """Drives; by default they deliver each torque exactly and without delay."""
    transmission: TransmissionDescription | None = None
    """Friction and elasticity of the true joints, unknown to the law; by default none."""
    start: StartDescription
    """The state at t = 0."""
    scheme: AnyScheme
    """The control scheme."""
    simulation: SimulationDescription
    """Time steps of the simulation, and its checks."""
    tolerance: ToleranceDescription | None = None
    """Tolerance band of a run, independent of the scheme's envelope; by default none."""

    truth: dict[str, Any] = Field(default={})
    """Values of the simulated loop by dotted path that replace the file's; unknown to the law. Studies write them."""
    uncertainty: Uncertainty = Field(default={})
    """Sets of uncertain values by dotted path. Studies draw from them; a single run uses the file's own values."""

    def build(self, name: str) -> Scenario:
        """Build the scenario; the values of `truth` apply to the true loop only, and the law does not know them.

        Raises DefinitionError, with the path of the field, if a part is invalid.
        """
        nominal = actual = self.moving()
        if self.truth:
            description = self.as_it_is()
            with locate_errors("truth"):
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

    def changed(self, changes: dict[str, Any]) -> Self:
        """Return a copy of the description with new values by dotted path.

        Raises DefinitionError if a value is invalid.
        """
        data = with_changes(self.model_dump(exclude_unset=True), changes)
        try:
            description = type(self).model_validate(data, context={"folder": Path()})
        except ValidationError as error:
            raise validation_error(error, data) from None
        description.as_it_is()
        return description

    def as_it_is(self) -> ScenarioDescription:
        """Return the description of the true loop: the values of `truth` replace those of the file.

        Raises DefinitionError if a value is invalid.
        """
        if not self.truth:
            return self
        of_robot = any(path.startswith("robot.") for path in self.truth)
        resolved = self.model_copy(update={"robot": self.robot.resolved()}) if of_robot else self
        data = resolved.model_dump(exclude_unset=True, exclude={"truth", "uncertainty"})
        with locate_errors("truth"):
            unseen = [path for path in self.truth if path.split(".")[0] in OF_THE_LAW]
            if unseen:
                message = f"is a setting of the law or simulation, so its value is never unknown: {KNOWN_TO_LAW_REMEDY}"
                raise DefinitionError(message, where=unseen[0])
            data = with_changes(data, dict(self.truth))
            try:
                return type(self).model_validate(data)
            except ValidationError as error:
                raise validation_error(error, data) from None

    @property
    def timing(self) -> Timing:
        """Sample time and delays of the loop."""
        return Timing(self.simulation.period, self.sensor.delay, self.actuator.dead_time)

    def moving(self) -> OpenLoop:
        """Build all parts of the closed loop except the law.

        Raises DefinitionError, with the path of the field, if a part is invalid.
        """
        with locate_errors("robot"):
            arms = self.robot.build()
            true = arms.true
        with locate_errors("actuator"):
            drive = self.actuator.of_robot(arms.limits)
            rate = drive.joint_limits(true.joints).rate
        with locate_errors("trajectory"):
            trajectory = trajectory_of(self.trajectory, arms.limits, arms.nominal, self.simulation.period, rate)
            followed = eqx.filter_eval_shape(trajectory.position, jax.ShapeDtypeStruct((), float)).shape
            if followed != (true.joints,):
                raise DefinitionError(f"moves {count_noun(followed[0], 'joint')}, but the robot has {true.joints}")
            warn_of_units(self.trajectory, trajectory, self.simulation.t1)
        with locate_errors("disturbance"):
            disturbance = self.disturbance.build()
            require_joints(disturbance, true.joints, type(true).__name__)
        with locate_errors("sensor"):
            sensor = self.sensor.build(self.simulation.period, true.joints)
        with locate_errors("actuator"):
            actuator = drive.build(true.joints)
        with locate_errors("start"):
            state0 = self.start.build(true.joints)
        transmission = None
        if self.transmission is not None:
            with locate_errors("transmission"):
                transmission = self.transmission.build(true.joints)
        plant = self._plant(Plant(true, disturbance, sensor, actuator, arms.load, transmission))
        return OpenLoop(arms, drive, plant, trajectory, state0)

    def law(self, moving: OpenLoop) -> AbstractController:
        """Build the law for the other parts of the loop, as the method `moving` builds them.

        Raises DefinitionError, with the path of the field, if it is invalid.
        """
        arms, drive, state0 = moving.arms, moving.drive, moving.state0
        true, nominal = arms.true, arms.nominal
        with locate_errors("actuator"):
            limits = drive.joint_limits(true.joints)
        with locate_errors("scheme"):
            sampled = self.scheme.sampled_data is not None
            find = partial(default_bound, true, nominal, arms.load, limits, sampled=sampled)
            scheme = self.scheme.with_bound(find).with_limit(limits.torque)
            bound = getattr(self.scheme, "bound", None)
            # A user's law may have a numeric parameter called `bound`.
            if isinstance(bound, PartDescription) and all(value is not None for _, value in bound):
                warn_of_implausible_bound(dict(bound), state0, limits, find)
            controller: AbstractController = scheme.build(nominal=nominal)
            if self.scheme.sampled_data is not None:
                sampling = Sampling(
                    period=self.simulation.period,
                    delay=self.timing.total_delay,
                    dead_time=self.timing.dead_time,
                    limits=limits,
                    variance=self.sensor.variance(),
                    has_velocity=self.sensor.has_velocity,
                    mass=nominal.mass(state0.q),
                    rotors=nominal.armature if isinstance(nominal, Articulated | Coupled) else None,
                    rated=_rated(limits.torque, arms.limits, true.joints),
                    limited=self.simulation.limits == "check",
                    jitter=self.sensor.jitter,
                )
                with locate_errors("sampled_data"):
                    controller = self.scheme.sampled_data.build(controller, sampling)
        with locate_errors("actuator"):
            return drive.known_to(controller)

    def _plant(self, own: Plant) -> Plant | MujocoPlant:
        with locate_errors("surroundings"):
            table = self.surroundings.build()
        if self.simulation.plant == "own":
            remedy = "set `simulation.plant` to `mujoco`"
            if table is not None:
                raise DefinitionError(
                    f"only MuJoCo simulates contact with surroundings: {remedy}", where="surroundings"
                )
            if self.simulation.friction == "dry":
                message = f"only MuJoCo simulates dry friction: {remedy}"
                raise DefinitionError(message, where="simulation.friction")
            return own
        with locate_errors("simulation.plant"):
            return MujocoPlant.of(own, surroundings=table, dry=self.simulation.friction == "dry")


def with_scheme(name: str, scheme: Preset | type[AbstractController]) -> type[ScenarioDescription]:
    """Return a subclass of `ScenarioDescription` for scenarios with a scheme from outside slidax.

    - `name`: name of the scheme, `scheme.name` in the scenario.
    - `scheme`: a preset, or the class of a law with a nominal arm and numeric parameters.
    """
    preset = scheme if isinstance(scheme, Preset) else Preset(scheme, (scheme.__doc__ or name).strip())
    return create_model(
        "ScenarioDescription", __base__=ScenarioDescription, scheme=(described_scheme(name, preset), ...)
    )
