"""Runs with other rotors than the law believes in, and what of them is shown."""

from __future__ import annotations

from typing import Any

import numpy as np
from sampled_data_figures.loops import steady_error, steady_step

from slidax import metrics, scenarios
from slidax.simulation import Run

ARMS = ("panda-payload", "ur5e-payload")
NOMINAL = (0.0, 0.03, 0.1, 0.2)
TRUE = (0.02, 0.05, 0.1, 0.3)
CORNERS = ((0.1, 0.1), (0.0, 0.1), (0.1, 0.03), (0.03, 0.3))
"""Nominal and true rotors [kg m²] that the harder cases are tried with."""

OFF = {"scheme.sampled_data.adaptation": None}


def run(name: str, nominal: float, true: float, changes: dict[str, Any] | None = None) -> Run:
    """A built-in scenario with the same rotor inertia on all joints.

    - `name`: of the scenario.
    - `nominal`, `true`: rotor inertia that the law believes in, and that the arm has [kg m²].
    - `changes`: as in `scenarios.load`.
    """
    rotors = {"robot.nominal.armature": nominal, "robot.plant.armature": true}
    return scenarios.load(name, {**rotors, **(changes or {})}).simulate(log_every=None, progress=False)


def outside(of: Run) -> int:
    """Samples outside the envelope.

    - `of`: a finished run.
    """
    count = metrics.envelope_violations(of)
    assert isinstance(count, int)
    return count


def worst(runs: list[Run]) -> tuple[int, float, float]:
    """Samples outside of all runs together, the largest steady error [rad] and the largest steady torque step [N m].

    - `runs`: finished runs.
    """
    return (
        sum(outside(one) for one in runs if one.has_envelope),
        float(np.max([steady_error(one) for one in runs])),
        float(np.max([steady_step(one) for one in runs])),
    )
