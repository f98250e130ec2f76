"""What a refusal says that the joints miss: the rule's own numbers, in simulated cases."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from slidax.design import read_problem
from slidax.design.proof import error_in_cases
from slidax.design.trials import Trials

REQUIREMENTS = """
robot:
  kind: two_link
  plant: {lengths: [1.0, 0.8], masses: [0.5, 1.5], inertias: [5.0, 5.0], gravity_acceleration: 9.8}
  nominal: {masses: [0.6, 1.8], inertias: [6.0, 6.0]}
trajectory: {kind: sinusoid, offset: [1.0, 1.0], amplitude: [0.3, 0.3], frequency: [2.0, 2.5]}
sensor: {resolution: 1.0e-5, velocity: differenced}
simulation: {period: 2.0e-3, substeps: 2, t1: 2.4}
uncertainty: {robot.plant.masses: {around: 20 %, each: joint}}
requirements: {deadline: 1.2}
"""


@pytest.mark.full
def test_a_joint_that_misses_more_than_the_rule_allows_is_named_with_both_numbers(tmp_path: Path) -> None:
    path = tmp_path / "requirements.yaml"
    path.write_text(REQUIREMENTS, encoding="utf-8")
    problem = read_problem(path)
    frame, first = import_module("slidax.design.design")._begin(problem)
    trials = Trials(problem, frame, first)
    wide = error_in_cases(trials, replace(first, final=np.full(2, 0.05)))
    assert not wide.beyond and wide.in_words() == "" and (wide.missed > 0.0).all()
    narrow = error_in_cases(trials, replace(first, final=np.array([1e-7, 0.05])))
    np.testing.assert_allclose(narrow.allowed[0], 0.9e-7 / first.horizon**2)
    assert narrow.beyond[0] == 0 and "`joint 1` misses" in narrow.in_words() and "(rule: " in narrow.in_words()
    assert set(narrow.as_json()) == {"joint 1", "joint 2"}
