import importlib
import json
import sys

import numpy as np
import pytest
from ruamel.yaml import YAML

from slidax.certify import admissibility
from slidax.design import search
from slidax.scenarios import load
from slidax.scenarios.family import Family
from slidax.studies.cases import StudyTask, points
from slidax.studies.runner import Runner

from .commands import answer_of, in_process

REQUIREMENTS = """
robot:
  kind: two_link
  plant: {lengths: [1.0, 0.8], masses: [0.5, 1.5], inertias: [5.0, 5.0], gravity_acceleration: 9.8}
  nominal: {masses: [0.6, 1.8], inertias: [6.0, 6.0]}
trajectory: {kind: sinusoid, offset: [1.0, 1.0], amplitude: [0.3, 0.3], frequency: [2.0, 2.5]}
sensor: {resolution: 1.0e-5, velocity: differenced}
actuator: {torque: 60, rate: 4000}
simulation: {period: 2.0e-3, substeps: 2, t1: 2.4}
uncertainty: {robot.plant.masses: {around: 20 %, each: joint}, start.q: {around: 0.1, each: joint}}
requirements: {deadline: 1.2, torque_step: 6}
"""


@pytest.fixture
def requirements(tmp_path):
    path = tmp_path / "requirements.yaml"
    path.write_text(REQUIREMENTS, encoding="utf-8")
    return path


@pytest.mark.full
def test_a_designed_scenario_runs_and_holds_in_unseen_cases(requirements, tmp_path, monkeypatch):
    # Fewer candidates and certificates; the certificates have their own tests.
    monkeypatch.setattr(search, "SLOPES", (1.0, 2.0))
    monkeypatch.setattr(importlib.import_module("slidax.certify.certify"), "CERTIFICATES", (admissibility,))
    out = tmp_path / "law.yaml"
    answer = answer_of("design", str(requirements), "--out", str(out), "--runs", "16")
    assert answer["designed"] is True and answer["proof"] == "tested"
    assert [item["name"] for item in answer["certificates"]] == ["admissibility", "statistical"]
    saved = json.loads((tmp_path / "law.certificate.json").read_text(encoding="utf-8"))
    assert saved["certificates"] == answer["certificates"]
    text = out.read_text(encoding="utf-8")
    assert "# Tested in simulation, not proved" in text and "certified by" not in text.lower()
    scenario = load(out)
    assert scenario.period == 2e-3 and scenario.controller.monitor is not None
    family = Family.of(scenario.description)
    rows = Runner(StudyTask.of(family, "auto"), 64).rows(
        0, family.space.values(points(9, 0, 64, family.space.dimensions))
    )
    assert np.all(rows["margin"] > 0) and np.all(rows["steady_torque_step"] < 6)


def test_design_for_weak_drives_exits_with_4_and_a_remedy(requirements, tmp_path):
    data = YAML(typ="safe").load(REQUIREMENTS)
    data["actuator"]["torque"] = 10
    with requirements.open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(data, file)
    out = tmp_path / "law.yaml"
    done = in_process("design", str(requirements), "--out", str(out), "--json", code=4)
    assert not out.exists()
    answer = json.loads(done.stdout)
    assert answer.keys() == {"designed", "reason", "would_do"} and answer["designed"] is False
    assert "`joint 1` needs up to" in answer["reason"] and "(limit: 10)" in answer["reason"]
    (remedy,) = answer["would_do"]
    assert remedy.keys() == {"words", "set"}
    needed = float(answer["reason"].partition("needs up to ")[2].split()[0])
    assert remedy["set"]["actuator.torque"][0] == pytest.approx(1.15 * needed, rel=0.01)


def test_invalid_requirements_exit_with_2(requirements, tmp_path):
    requirements.write_text(REQUIREMENTS.replace("deadline: 1.2", "deadline: -1"), encoding="utf-8")
    done = in_process("design", str(requirements), "--out", str(tmp_path / "law.yaml"), code=2)
    assert "requirements.deadline" in done.output
    done = in_process("design", str(requirements), "--out", str(tmp_path / "law.json"), code=2)
    assert "ending .yaml" in done.output


def test_missing_package_is_reported_before_the_design_starts(requirements, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cmaes", None)
    refused = in_process("design", str(requirements), "--out", str(tmp_path / "designed.yaml"), code=2)
    assert "slidax[studies]" in refused.output and "horizon" not in refused.output
