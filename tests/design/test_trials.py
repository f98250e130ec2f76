"""On which cases laws are compared."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from slidax.design.candidates import DesignPoint
from slidax.design.design import _begin
from slidax.design.problem import read_problem
from slidax.design.trials import BEYOND, Trials

ARMATURE, LOAD = "robot.plant.armature", "robot.plant.load.mass"


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Trials:
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


def test_each_joint_is_once_light_among_heavy_ones_and_once_heavy_among_light_ones(trials: Trials) -> None:
    rotors = trials.cases(48)[ARMATURE]
    for joint in range(6):
        others = np.delete(np.arange(6), joint)
        light = (rotors[:, joint] < 0.11) & (rotors[:, others] > 0.29).all(axis=1)
        heavy = (rotors[:, joint] > 0.29) & (rotors[:, others] < 0.11).all(axis=1)
        assert light.any()
        assert heavy.any()


def test_in_the_search_an_arm_is_unknown_by_more_and_its_starts_are_not(trials: Trials) -> None:
    cases, beyond = trials.cases(48), trials.beyond(48)
    assert np.allclose(beyond[ARMATURE] - 0.2, BEYOND * (cases[ARMATURE] - 0.2))
    assert np.array_equal(beyond["start.q"], cases["start.q"])
    # Nothing weighs less than nothing.
    assert beyond[LOAD].min() == 0.0
    assert beyond[LOAD].max() > 2.0


def test_hard_cases_are_among_the_few_behind_the_corners_the_newest_first(trials: Trials) -> None:
    def hard(value: float) -> dict[str, Any]:
        return {path: np.full_like(array[:2], value) for path, array in trials.cases(8).items()}

    harder = trials.with_harder(hard(0.21)).with_harder(hard(0.22))
    assert np.allclose(harder.cases(8)[ARMATURE][4:, 0], [0.22, 0.22, 0.21, 0.21])
    assert np.allclose(harder.cases(6)[ARMATURE][3:, 0], [0.22, 0.22, 0.21])
    assert np.array_equal(harder.cases(8)[ARMATURE][:4], trials.cases(8)[ARMATURE][:4])
    assert len(harder.cases(48)[ARMATURE]) == 48


def test_a_part_of_the_set_is_as_small_as_asked(trials: Trials) -> None:
    assert replace(trials, smaller={LOAD: 0.5}).cases(8)[LOAD].max() == pytest.approx(1.0)


def test_what_a_joint_asks_of_its_drive_is_counted_by_its_own_limit(trials: Trials) -> None:
    choice = DesignPoint(0.01, 1.0, 1.0, np.full(6, 0.05), 1.0)

    def driven(*changes: float) -> float:
        frame = replace(trials.frame, changes=np.array(changes))
        return replace(trials, frame=frame).judged([choice], trials.cases(2))[0].driven

    step = trials.judged([choice], trials.cases(2))[0].step
    assert driven(*[2.0] * 6) == pytest.approx(step / 2.0)
    assert driven(*[np.inf] * 6) == 0.0
    # A wrist that no one would notice beside the shoulder is noticed at its own drive.
    wrist = driven(*[np.inf] * 5, 2.0)
    assert 0.0 < wrist < driven(*[2.0] * 6)
    assert driven(*[2.0] * 5, 1e-4) == pytest.approx(2e4 * wrist)
