"""Studies of the two-link arm, short enough to be run in tests."""

from __future__ import annotations

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
"""A study in which every run fails: the push is stronger than the drives."""


def study(**changes: Any) -> Any:
    """The study with other values."""
    result: AbstractStudy = study_of({**STUDY, **changes})
    return result


def ran(out: Path | None = None, *, resume: bool = False, **changes: Any) -> Any:
    """What it finds."""
    request = study(**changes)
    assert isinstance(request, MonteCarlo)
    return request.run(RunOptions(out, resume))
