"""Requirements files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from slidax._errors import DefinitionError, as_array, each_of, located, plain
from slidax.scenarios import ScenarioDescription
from slidax.scenarios.base import AbstractDescription, Numbers, said
from slidax.scenarios.description import StartDescription
from slidax.scenarios.disturbances import DisturbanceDescription
from slidax.scenarios.instruments import ActuatorDescription, SensorDescription
from slidax.scenarios.load import validated
from slidax.scenarios.mistakes import translated
from slidax.scenarios.robots import RobotDescription
from slidax.scenarios.trajectories import TrajectoryDescription, trajectory_of
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.scenarios.yaml_text import read_yaml_file, require_readable

from .workspace import WorkspaceDescription

AFTER = 6.0
"""A run goes on for so long after the deadline, s, so that the motion is seen as a whole."""


class Requirements(AbstractDescription):
    """Requirements for the law."""

    deadline: float = said("from when on the error is within its final radius", "s", "> 0", default=2.0)
    accuracy: Literal["best"] | Annotated[Numbers, Field()] = "best"
    """The final radius that must be reached [rad or m], for all joints or each; `best`: the smallest one found."""
    torque_step: float | None = said(
        "largest change of the torque from sample to sample in steady state", "N m or N", "> 0", default=None
    )
    proof: Literal["tested", "bound"] = "tested"
    """`bound` refuses a law for which `loop_rate` has no bound of the error, `tested` takes it and says so."""


class TimeDescription(AbstractDescription):
    """Timing of the commands."""

    period: float = said("time between two samples", "s", "> 0")
    substeps: int = said("integrator steps a period", "", "[1, 10000]", default=10)
    t1: float | None = said("end of the runs", "s", "> 0", default=None, source="6 s after the deadline")


class DesignProblem(AbstractDescription):
    """An arm, what it must do, what is not known of it, and the requirements."""

    title: str = ""
    """One line for a person."""
    robot: RobotDescription
    """The arm that moves, and the arm as the law knows it."""
    trajectory: TrajectoryDescription | None = None
    """Reference motion of the joints."""
    workspace: WorkspaceDescription | None = None
    """Where and how fast the joints move, in place of a trajectory."""
    disturbance: DisturbanceDescription = DisturbanceDescription()
    """External disturbances."""
    sensor: SensorDescription = SensorDescription()
    """Sensors."""
    actuator: ActuatorDescription = ActuatorDescription()
    """Drives."""
    start: StartDescription | None = None
    """The state at t = 0; on the motion if not given."""
    simulation: TimeDescription
    """Timing of the commands."""
    uncertainty: Uncertainty = Field(default={})
    """Uncertainty: a set of values by path."""
    requirements: Requirements = Requirements()
    """Requirements for the law."""

    @property
    def t1(self) -> float:
        """The end of its runs, a whole number of periods [s]."""
        period = self.simulation.period
        end = self.requirements.deadline + AFTER if self.simulation.t1 is None else self.simulation.t1
        return float(round(end / period) * period)

    def blocks(self) -> dict[str, Any]:
        """Return the blocks of a scenario other than its law and its time.

        Raises DefinitionError, with the path of the field, if the motion cannot be.
        """
        data = self.model_dump(exclude_unset=True, exclude={"title", "workspace", "requirements", "simulation"})
        with located("robot"):
            arms = self.robot.build()
        if self.workspace is not None:
            with located("workspace"):
                data["trajectory"] = self.workspace.motion(arms)
        if self.start is None:
            with located("trajectory"):
                described = TypeAdapter(TrajectoryDescription).validate_python(data["trajectory"])
                motion = trajectory_of(described, arms.limits, arms.nominal)
                reference = motion.reference(as_array(0.0))
            data["start"] = {"q": np.asarray(reference.q).tolist(), "dq": np.asarray(reference.dq).tolist()}
        return data

    def scenario(self, scheme: dict[str, Any]) -> ScenarioDescription:
        """Return the scenario of this problem with a law, as `scheme` of a scenario file.

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
        title = self.title or f"{plain(self.robot.kind)} at {1.0 / h:g} Hz"
        return validated({"title": title, **self.blocks(), "scheme": scheme, "simulation": time})


def read_problem(path: str | Path) -> DesignProblem:
    """The requirements in a YAML file.

    - `path`: of the file; files that it names are found from its folder.

    Raises DefinitionError with the path of the first field that is wrong.
    """
    path = Path(path)
    data = read_yaml_file(path, "the requirements")
    if not isinstance(data, dict):
        raise DefinitionError("requirements are a mapping with the keys " + ", ".join(DesignProblem.model_fields))
    require_readable(data)
    try:
        result = DesignProblem.model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        raise translated(error, data) from None
    if (result.trajectory is None) == (result.workspace is None):
        raise DefinitionError("needs either `trajectory` or `workspace`")
    _require_accuracy(result)
    if result.t1 <= result.requirements.deadline:
        raise DefinitionError(f"must be after the deadline; got {result.t1:g}", where="simulation.t1")
    return result


def _require_accuracy(result: DesignProblem) -> None:
    required = result.requirements.accuracy
    if required == "best":
        return
    numbers = np.asarray(required, float)
    with located("requirements.accuracy"):
        if not (np.isfinite(numbers).all() and (numbers > 0).all()):
            raise DefinitionError(f"must be > 0, or `best`; got {plain(required)}")
        joints = result.robot.build().true.joints
        if numbers.ndim and len(numbers) != joints:
            raise DefinitionError(f"must be one number or one for {each_of(joints, 'joint')}; got {len(numbers)}")
