"""Requirements files: an arm, its motion or workspace, its uncertainty, and the requirements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from slidax.core.errors import DefinitionError, as_array, each_of, locate_errors, plain_name
from slidax.scenarios.descriptions import AbstractDescription, Numbers, input_field
from slidax.scenarios.instruments import ActuatorDescription, DisturbanceDescription, SensorDescription
from slidax.scenarios.load import validate_text
from slidax.scenarios.robots import Arms, RobotDescription
from slidax.scenarios.scenario import ScenarioDescription, StartDescription
from slidax.scenarios.trajectories import TrajectoryDescription, trajectory_of
from slidax.scenarios.uncertainty import Uncertainty
from slidax.scenarios.yaml_text import read_yaml_file, require_readable, validation_error

ROOM = 0.8
"""Share of the workspace's range that the motion uses."""

SPREAD = 0.85
"""Frequency of the slowest joint over that of the fastest; as they differ, the joints pass through all combinations."""


class RangeDescription(AbstractDescription):
    """Range of the joints' positions."""

    low: Numbers = input_field("least positions", "rad or m")
    high: Numbers = input_field("largest positions", "rad or m")


class WorkspaceDescription(AbstractDescription):
    """Range, largest speed and largest acceleration of the joints' motion."""

    q: RangeDescription | None = None
    """Range of the positions; by default the joints' position limits."""
    speed: Numbers = input_field("largest speed", "rad/s or m/s")
    acceleration: Numbers = input_field("largest acceleration", "rad/s² or m/s²")

    def motion(self, arms: Arms) -> dict[str, Any]:
        """Return a trajectory as in a scenario file: sinusoids about the middle of the range.

        A joint's amplitude A is 80 % of half its range, or v²/a if that is smaller, with the largest speed v and the
        largest acceleration a. Its frequency ω is a share, 0.85 to 1, of the largest one with `A ω <= v` and
        `A ω² <= a`; the shares differ between the joints.

        - `arms`: the arms of the scenario.

        Raises DefinitionError as `ends` does, and if a limit is not > 0 or does not fit the number of joints.
        """
        n = arms.true.joints
        low, high = self.ends(arms)
        speed, acceleration = self._each("speed", self.speed, n), self._each("acceleration", self.acceleration, n)
        amplitude = np.minimum(ROOM * 0.5 * (high - low), speed**2 / acceleration)
        slower = np.linspace(1.0, SPREAD, n)
        slower = np.concatenate([slower[::2], slower[1::2]])
        frequency = slower * np.minimum(speed / amplitude, np.sqrt(acceleration / amplitude))
        return {
            "kind": "sinusoid",
            "offset": _rounded(0.5 * (low + high)),
            "amplitude": _rounded(amplitude),
            "frequency": _rounded(frequency),
        }

    def ends(self, arms: Arms) -> tuple[Any, Any]:
        """Return the least and the largest positions of the joints, [n] each, rad or m.

        - `arms`: the arms of the scenario; their position limits are used if the file has no range.

        Raises DefinitionError if the range is empty or does not fit the number of joints, or neither the file nor the
        arm has one.
        """
        joints = arms.true.joints
        if self.q is not None:
            low, high = self._each("q.low", self.q.low, joints, None), self._each("q.high", self.q.high, joints, None)
        elif arms.limits is not None:
            low, high = np.asarray(arms.limits.lower, float), np.asarray(arms.limits.upper, float)
        else:
            raise DefinitionError("this robot has no position limits: give `low` and `high`", where="q")
        if not np.isfinite(low).all() or not np.isfinite(high).all():
            raise DefinitionError("a joint of this robot has no position limits: give `low` and `high`", where="q")
        if (low >= high).any():
            joint = int(np.argmax(low >= high))
            raise DefinitionError(
                f"`low` must be < `high`; joint {joint + 1} has {low[joint]:g} and {high[joint]:g}", where="q"
            )
        return low, high

    @staticmethod
    def _each(where: str, value: Numbers, joints: int, above: float | None = 0.0) -> Any:
        numbers = np.asarray(value, float)
        if numbers.ndim and len(numbers) != joints:
            message = f"must be one number or one for {each_of(joints, 'joint')}; got {len(numbers)}"
            raise DefinitionError(message, where=where)
        if not np.isfinite(numbers).all() or (above is not None and (numbers <= above).any()):
            raise DefinitionError(f"must be finite{'' if above is None else ' and > 0'}; got {value}", where=where)
        return np.broadcast_to(numbers, (joints,)).astype(float)


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.4g}") for value in values]


AFTER = 6.0
"""Duration of a run after the deadline [s]."""


class Requirements(AbstractDescription):
    """Requirements for the law."""

    deadline: float = input_field("time from which on the error is within its final radius", "s", "> 0", default=2.0)
    accuracy: Literal["best"] | Annotated[Numbers, Field()] = "best"
    """Required final radius [rad or m], for all joints or each; `best` for the smallest that the search finds."""
    torque_step: float | None = input_field(
        "largest change of the torque from sample to sample in steady state", "N m or N", "> 0", default=None
    )
    proof: Literal["tested", "bound"] = "tested"
    """`bound` requires a bound by `tracking_bound`; `tested` accepts laws that are only tested in simulation."""


class TimeDescription(AbstractDescription):
    """Timing of the commands."""

    period: float = input_field("time between two samples", "s", "> 0")
    substeps: int = input_field("integrator steps per period", "", "[1, 10000]", default=10)
    t1: float | None = input_field("end of the runs", "s", "> 0", default=None, source="6 s after the deadline")


class DesignProblem(AbstractDescription):
    """An arm, its task, its uncertainty, and the requirements."""

    title: str = ""
    """Title in one line."""
    robot: RobotDescription
    """The arm that moves, and the arm as the law knows it."""
    trajectory: TrajectoryDescription | None = None
    """Reference motion of the joints."""
    workspace: WorkspaceDescription | None = None
    """Range, speed and acceleration of the joints' motion, instead of a trajectory."""
    disturbance: DisturbanceDescription = DisturbanceDescription()
    """External disturbances on the joints."""
    sensor: SensorDescription = SensorDescription()
    """Sensors."""
    actuator: ActuatorDescription = ActuatorDescription()
    """Drives."""
    start: StartDescription | None = None
    """The state at t = 0; on the motion if not given."""
    simulation: TimeDescription
    """Timing of the commands."""
    uncertainty: Uncertainty = Field(default={})
    """Uncertain values: a set for each dotted path of the scenario, such as `robot.plant.load.mass`."""
    requirements: Requirements = Requirements()
    """Requirements for the law."""

    @property
    def t1(self) -> float:
        """End of the runs, a whole number of periods [s]."""
        period = self.simulation.period
        end = self.requirements.deadline + AFTER if self.simulation.t1 is None else self.simulation.t1
        return float(round(end / period) * period)

    def blocks(self) -> dict[str, Any]:
        """Return the blocks of a scenario file by their names, except the law and the simulation.

        Raises DefinitionError, with the path of the field, if the motion is impossible.
        """
        data = self.model_dump(exclude_unset=True, exclude={"title", "workspace", "requirements", "simulation"})
        with locate_errors("robot"):
            arms = self.robot.build()
        if self.workspace is not None:
            with locate_errors("workspace"):
                data["trajectory"] = self.workspace.motion(arms)
        if self.start is None:
            with locate_errors("trajectory"):
                described = TypeAdapter(TrajectoryDescription).validate_python(data["trajectory"])
                rate = self.actuator.of_robot(arms.limits).limits().rate
                motion = trajectory_of(described, arms.limits, arms.nominal, self.simulation.period, rate)
                reference = motion.reference(as_array(0.0))
            data["start"] = {"q": np.asarray(reference.q).tolist(), "dq": np.asarray(reference.dq).tolist()}
        return data

    def scenario(self, scheme: dict[str, Any]) -> ScenarioDescription:
        """Return the scenario of this problem with a law.

        - `scheme`: the law, as the block `scheme` of a scenario file.

        Raises DefinitionError, with the path of the field, if something is invalid.
        """
        h = self.simulation.period
        time = {
            "mode": "held",
            "integrator": "semi_implicit_euler",
            "period": h,
            "substeps": self.simulation.substeps,
            "t1": float(round(self.t1 / h) * h),
            "outside": "recover",
        }
        title = self.title or f"{plain_name(self.robot.kind)} at {1.0 / h:g} Hz"
        return validate_text({"title": title, **self.blocks(), "scheme": scheme, "simulation": time})


def read_problem(path: str | Path) -> DesignProblem:
    """Read the requirements in a YAML file; file names in it are relative to its folder.

    Raises DefinitionError with the path of the first invalid field.
    """
    path = Path(path)
    data = read_yaml_file(path, "the requirements")
    if not isinstance(data, dict):
        raise DefinitionError(
            "the requirements must be a mapping with some of the keys " + ", ".join(DesignProblem.model_fields)
        )
    require_readable(data)
    try:
        result = DesignProblem.model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        raise validation_error(error, data) from None
    if (result.trajectory is None) == (result.workspace is None):
        raise DefinitionError("the requirements must have one of the blocks `trajectory` and `workspace`, not both")
    _require_accuracy(result)
    if result.t1 <= result.requirements.deadline:
        raise DefinitionError(
            f"must be after the deadline (`requirements.deadline`); got {result.t1:g}", where="simulation.t1"
        )
    return result


def _require_accuracy(result: DesignProblem) -> None:
    required = result.requirements.accuracy
    if required == "best":
        return
    numbers = np.asarray(required, float)
    with locate_errors("requirements.accuracy"):
        if not (np.isfinite(numbers).all() and (numbers > 0).all()):
            raise DefinitionError(f"must be > 0, or `best`; got {plain_name(required)}")
        joints = result.robot.build().true.joints
        if numbers.ndim and len(numbers) != joints:
            raise DefinitionError(f"must be one number or one for {each_of(joints, 'joint')}; got {len(numbers)}")
