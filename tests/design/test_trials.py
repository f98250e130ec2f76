"""Common cases of the candidate laws, the first law of a design, and its estimation error."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from slidax.design import read_problem
from slidax.design.candidates import DesignPoint
from slidax.design.design import _begin
from slidax.design.proof import error_in_cases
from slidax.design.trials import BEYOND, Trials
from tests.design.test_requirements import EXAMPLES

ARMATURE, LOAD = "robot.plant.armature", "robot.plant.load.mass"


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    request: dict[str, Any] = {
        "robot": {"kind": "ur5e", "plant": {"load": {"mass": 1.0}}},
        "workspace": {"speed": 0.5, "acceleration": 1.0},
        "actuator": {"torque": "robot"},
        "simulation": {"period": 2e-3, "t1": 1.0},
        "uncertainty": {
            ARMATURE: {"between": [[0.1] * 6, [0.3] * 6], "each": "joint"},
            LOAD: {"between": [0.0, 2.0]},
            "start.q": {"around": 0.1, "each": "joint"},
        },
        "requirements": {"deadline": 0.5, "accuracy": "best"},
    }
    path = tmp_path_factory.mktemp("asked") / "asked.yaml"
    path.write_text(yaml.safe_dump(request), encoding="utf-8")
    problem = read_problem(path)
    return Trials(problem, *_begin(problem))


def test_cases_include_each_rotor_light_among_heavy_rotors_and_heavy_among_light_rotors(trials):
    rotors = trials.cases(48)[ARMATURE]
    for joint in range(6):
        others = np.delete(np.arange(6), joint)
        light = (rotors[:, joint] < 0.11) & (rotors[:, others] > 0.29).all(axis=1)
        heavy = (rotors[:, joint] > 0.29) & (rotors[:, others] < 0.11).all(axis=1)
        assert light.any() and heavy.any()


def test_search_cases_widen_the_uncertainty_of_the_arm_but_not_of_its_start(trials):
    cases, beyond = trials.cases(48), trials.widened_cases(48)
    assert np.allclose(beyond[ARMATURE] - 0.2, BEYOND * (cases[ARMATURE] - 0.2))
    assert np.array_equal(beyond["start.q"], cases["start.q"])
    # A mass is not negative.
    assert beyond[LOAD].min() == 0.0 and beyond[LOAD].max() > 2.0


def test_worst_cases_of_failed_checks_follow_the_corner_cases_newest_first(trials):
    def hard(value: float) -> dict[str, Any]:
        return {path: np.full_like(array[:2], value) for path, array in trials.cases(8).items()}

    harder = trials.with_harder(hard(0.21)).with_harder(hard(0.22))
    assert np.allclose(harder.cases(8)[ARMATURE][4:, 0], [0.22, 0.22, 0.21, 0.21])
    assert np.allclose(harder.cases(6)[ARMATURE][3:, 0], [0.22, 0.22, 0.21])
    assert np.array_equal(harder.cases(8)[ARMATURE][:4], trials.cases(8)[ARMATURE][:4])
    assert len(harder.cases(48)[ARMATURE]) == 48


def test_a_reduced_set_keeps_its_lower_end(trials):
    masses = trials.with_smaller_sets({LOAD: 0.5}).cases(8)[LOAD]
    assert masses.min() == 0.0 and masses.max() == pytest.approx(1.0)


def test_torque_step_of_a_joint_is_relative_to_its_own_limit(trials):
    choice = DesignPoint(0.01, 1.0, 1.0, np.full(6, 0.05), 1.0)

    def drive_share(*changes: float) -> float:
        space = replace(trials.space, changes=np.array(changes))
        return replace(trials, space=space).evaluate([choice], trials.cases(2))[0].drive_share

    step = trials.evaluate([choice], trials.cases(2))[0].step
    assert drive_share(*[2.0] * 6) == pytest.approx(step / 2.0) and drive_share(*[np.inf] * 6) == 0.0
    # A step that is small for the shoulder's drive still counts at the wrist's own drive.
    wrist = drive_share(*[np.inf] * 5, 2.0)
    assert 0.0 < wrist < drive_share(*[2.0] * 6) and drive_share(*[2.0] * 5, 1e-4) == pytest.approx(2e4 * wrist)


@pytest.mark.parametrize("proof", ["bound", "tested"])
def test_a_required_bound_gives_a_law_without_adaptation(proof, tmp_path):
    data = yaml.safe_load((EXAMPLES / "panda-along.yaml").read_text(encoding="utf-8"))
    data["requirements"]["proof"] = proof
    path = tmp_path / "requirements.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    space, choice = _begin(read_problem(path))
    scenario: Any = space.described(choice).build("begun")
    assert (scenario.controller.adaptation is None) is space.along is (proof == "bound")


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
def test_a_joint_beyond_the_loop_rate_rule_is_named_with_error_and_limit(tmp_path):
    path = tmp_path / "requirements.yaml"
    path.write_text(REQUIREMENTS, encoding="utf-8")
    problem = read_problem(path)
    space, first = _begin(problem)
    trials = Trials(problem, space, first)
    wide = error_in_cases(trials, replace(first, final=np.full(2, 0.05)))
    assert not wide.beyond and wide.in_words() == "" and (wide.missed > 0.0).all()
    narrow = error_in_cases(trials, replace(first, final=np.array([1e-7, 0.05])))
    np.testing.assert_allclose(narrow.allowed[0], 0.9e-7 / first.horizon**2)
    assert narrow.beyond[0] == 0 and "`joint 1` has an estimation error" in narrow.in_words()
    assert "(limit: " in narrow.in_words()
    assert set(narrow.as_json()) == {"joint 1", "joint 2"}
