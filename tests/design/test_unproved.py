"""What would do where a certificate is required and none is had."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from slidax.certify import Verdict
from slidax.design import refusal
from slidax.design.candidates import DesignPoint
from slidax.design.design import _begin
from slidax.design.problem import read_problem
from slidax.design.trials import Trials

NONE = Verdict("loop_rate", "", False, None, {}, (), "It grows")


def trials(folder: Path, told: bool = False, accuracy: Any = "best") -> Trials:
    load = {"mass": 1.0, "center": [0.0, 0.0, 0.1]}
    request: dict[str, Any] = {
        "robot": {"kind": "ur5e", "plant": {"load": load}, "nominal": {"load": load} if told else {}},
        "workspace": {"speed": 0.5, "acceleration": 1.0},
        "actuator": {"torque": "robot"},
        "simulation": {"period": 2e-3, "t1": 1.0},
        "uncertainty": {"robot.plant.load.mass": {"between": [0.8, 1.2]}},
        "requirements": {"deadline": 0.5, "accuracy": accuracy, "proof": "bound"},
    }
    path = folder / "asked.yaml"
    path.write_text(yaml.safe_dump(request), encoding="utf-8")
    problem = read_problem(path)
    return Trials(problem, *_begin(problem))


@pytest.fixture
def certified(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Scenarios of which a certificate was asked, which they have with these radii; None: with none."""

    def with_radius(radius: float | None) -> list[Any]:
        request: list[Any] = []

        def rate(scenario: Any) -> Verdict:
            request.append(scenario.description)
            if radius is None:
                return NONE
            final = np.asarray(scenario.controller.step.transformation.performance.final)
            bound = {"required_radius": np.full(6, radius)}
            return Verdict("loop_rate", "", bool((final >= radius).all()), 0.0, bound, (), "")

        monkeypatch.setattr(refusal, "loop_rate_verdict", rate)
        return request

    return with_radius


CHOICE = DesignPoint(0.01, 1.0, 0.5, np.full(6, 1e-3), 1.0)


def test_a_law_that_does_not_know_its_payload_is_told_of_the_middle_of_its_set(tmp_path: Path, certified: Any) -> None:
    request = certified(3e-3)
    first, last = refusal.proof_refusal(trials(tmp_path), CHOICE, NONE).would_do
    assert first.words == "a law that is told of 1 kg at its tip"
    assert first.changes == {"robot.nominal.load": {"mass": 1.0, "center": [0.0, 0.0, 0.1]}}
    assert last.changes == {"requirements.proof": "tested"}
    assert [item.robot.nominal.load.mass for item in request] == [1.0, 1.0]


@pytest.mark.parametrize("radius", [None, 1e3], ids=["no radius", "one beyond the envelope"])
def test_nothing_is_promised_of_a_payload_that_would_not_do(tmp_path: Path, certified: Any, radius: Any) -> None:
    certified(radius)
    (only,) = refusal.proof_refusal(trials(tmp_path), CHOICE, NONE).would_do
    assert only.changes == {"requirements.proof": "tested"}


def test_a_law_that_knows_of_a_payload_is_not_told_again(tmp_path: Path, certified: Any) -> None:
    request = certified(1e-4)
    assert len(refusal.proof_refusal(trials(tmp_path, told=True), CHOICE, NONE).would_do) == 1
    assert not request


def refused_at(radius: float) -> Verdict:
    return Verdict("loop_rate", "", False, 0.0, {"required_radius": np.full(6, radius)}, (), "It is wide")


def test_an_accuracy_is_named_that_is_certified(tmp_path: Path, certified: Any) -> None:
    # Of the wider one more is asked for.
    request = certified(1.08e-3)
    result = refusal.proof_refusal(trials(tmp_path, told=True, accuracy=1e-3), CHOICE, refused_at(1.05e-3)).would_do
    assert [item.words for item in result] == ["an accuracy of 0.00113", "what is tested in simulation alone"]
    assert result[0].changes == {"requirements.accuracy": [1.134e-3] * 6}
    assert len(request) == 2


def test_no_accuracy_is_named_where_none_is_certified_or_the_best_was_looked_for(
    tmp_path: Path, certified: Any
) -> None:
    request = certified(None)
    laws = trials(tmp_path, told=True, accuracy=1e-3)
    assert len(refusal.proof_refusal(laws, CHOICE, refused_at(1.05e-3)).would_do) == 1
    assert len(request) == 1
    laws = trials(tmp_path, told=True)
    assert len(refusal.proof_refusal(laws, CHOICE, refused_at(1.05e-3)).would_do) == 1
    assert len(request) == 1
