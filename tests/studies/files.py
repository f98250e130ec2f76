"""Studies short enough to be run in tests."""

from pathlib import Path
from typing import Any

from slidax.studies import AbstractStudy, MonteCarlo, RunOptions, study_of

UNCERTAIN: dict[str, Any] = {
    "robot.plant.masses": {"around": "20 %"},
    "disturbance.scale": {"between": [0, 1]},
    "start": {"inside": "envelope", "share": 0.5},
}

STUDY: dict[str, Any] = {
    "study": "monte_carlo",
    "scenario": "example-4.1-1khz",
    "changes": {"simulation.t1": 0.2},
    "uncertainty": UNCERTAIN,
    "runs": 200,
    "seed": 5,
}

FAILING: dict[str, Any] = {**STUDY, "uncertainty": {"disturbance.scale": {"between": [150, 200]}}, "runs": 64}
"""A study in which every run fails: the disturbance is stronger than the drives."""


def study(**changes: Any) -> Any:
    result: AbstractStudy = study_of({**STUDY, **changes})
    return result


def ran(out: Path | None = None, *, resume: bool = False, **changes: Any) -> Any:
    request = study(**changes)
    assert isinstance(request, MonteCarlo)
    return request.run(RunOptions(out, resume))


SMALL_SETS = {
    "robot.plant.masses": {"around": "20 %"},
    "robot.plant.inertias": {"around": "20 %", "each": "joint"},
    "disturbance.scale": {"between": [0.0, 1.2]},
    "start.q": {"around": 0.06, "each": "joint"},
}

SHORT = {"simulation.t1": 0.5, "simulation.substeps": 1, "simulation.log_every": 1}

WEAK = {
    "robot.plant.masses": {"around": "20 %", "each": "joint"},
    "robot.plant.inertias": {"around": "20 %", "each": "joint"},
    "robot.plant.lengths": {"around": "10 %", "each": "joint"},
    "disturbance.scale": {"between": [0.0, 1.2]},
    "start.q": {"around": 0.06, "each": "joint"},
    "start.dq": {"between": [-0.03, 0.03], "each": "joint"},
}
"""Uncertainty of an arm whose drives may be too weak: for a short second link, large masses and a low start."""


def result_of(kind, **text):
    return study_of_kind(kind, **text).run(RunOptions())


def study_of_kind(kind, **text):
    common = {"scenario": "example-4.1-1khz", "changes": SHORT, "uncertainty": SMALL_SETS}
    return study_of({**common, "study": kind, **text})


def weak(kind, torque, **text):
    changes = {"simulation.t1": 3.0, "simulation.substeps": 2, "actuator.torque": torque}
    return result_of(kind, changes=changes, uncertainty=WEAK, **text)
