"""Designs whose error is bounded along a motion that ends at rest."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from slidax.certify import Verdict
from slidax.design import read_problem, refusal, search
from slidax.design.candidates import DesignPoint, template
from slidax.design.design import _begin, law_with_bound
from slidax.design.proof import certified_radii, tracking_verdict
from tests.cli.commands import in_process
from tests.design.test_requirements import EXAMPLES

design = sys.modules["slidax.design.design"]

FILE = EXAMPLES / "panda-along.yaml"
LAW = DesignPoint(0.01, 1.0, 1.0, np.array([1e-3, 2e-3]), 0.3)


def space_of(file: Path = FILE) -> Any:
    return _begin(read_problem(file))[0]


def test_the_tracking_bound_holds_for_a_law_built_with_a_required_bound():
    space = space_of(EXAMPLES / "two-link-along.yaml")
    described = space.described(DesignPoint(0.04, 1.0, 1.0, np.full(2, 0.0125), 1.0))
    law = described.build("law")
    assert space.along and law.controller.adaptation is None and law.controller.midpoint
    verdict = tracking_verdict(described)
    assert verdict.holds is True
    (envelope,) = (line for line in verdict.assumptions if "inside the envelope" in line.text)
    assert envelope.status == "proved"


def test_law_with_bound_returns_the_law_with_the_smallest_bounded_error_of_the_grid(monkeypatch):
    tried = []

    def verdict_of(described: Any) -> Verdict:
        block = described.scheme.sampled_data
        tried.append((block.horizon, block.estimator.acceleration_density))
        holds = 0.014 <= block.horizon <= 0.02 and block.estimator.acceleration_density == 1.0
        return Verdict("tracking_bound", "", holds, None, {"error": np.full(7, block.horizon)}, (), "")

    monkeypatch.setattr(design, "tracking_verdict", verdict_of)
    law, verdict = law_with_bound(space_of(), LAW)
    assert verdict.holds and (law.horizon, law.drift) == (0.014, 1.0) and law.final is LAW.final
    # Only the horizons below the first failure after a success are left out.
    assert len(set(tried)) == 20 and (0.006, 1.0) not in tried


def test_refusal_lists_changes_of_requirements_that_give_a_bound(monkeypatch):
    def verdict_of(described: Any) -> Verdict:
        fine = described.sensor.resolution <= 1e-7
        slow = described.trajectory.times[-1] >= 2.2
        return Verdict("tracking_bound", "", fine or slow, None, {}, (), "")

    monkeypatch.setattr(refusal, "tracking_verdict", verdict_of)
    grows = Verdict("tracking_bound", "", False, None, {}, (), "The bound grows.")
    answer = refusal.proof_refusal(read_problem(FILE), space_of(), replace(LAW, final=np.full(7, 1e-3)), grows)
    assert [dict(item.changes) for item in answer.would_do] == [
        {"sensor.resolution": 1e-7},
        {"trajectory.times": [0.0, pytest.approx(2.4)]},
        {"requirements.proof": "tested"},
    ]
    assert "`tracking_bound` gives none: The bound grows." in answer.reason


LOAD = {"mass": 1.0, "center": [0.0, 0.0, 0.1]}


def test_refusal_proposes_the_mean_payload_for_the_nominal_arm(tmp_path, monkeypatch):
    data = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    data["robot"] = {"kind": "panda", "plant": {"load": LOAD}}
    data["uncertainty"] = {"robot.plant.load.mass": {"between": [0.8, 1.0]}}
    path = tmp_path / "load.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")

    def verdict_of(described: Any) -> Verdict:
        known = described.robot.nominal.load
        return Verdict("tracking_bound", "", known is not None and known.mass == 0.9, None, {}, (), "")

    monkeypatch.setattr(refusal, "tracking_verdict", verdict_of)
    problem = read_problem(path)
    law, grows = replace(LAW, final=np.full(7, 1e-3)), Verdict("tracking_bound", "", False, None, {}, (), "It grows.")
    known, tested = refusal.proof_refusal(problem, _begin(problem)[0], law, grows).would_do
    assert known.changes == {"robot.nominal.load": {**LOAD, "mass": 0.9}} and "knows 0.9 kg" in known.words
    assert tested.changes == {"requirements.proof": "tested"}


@pytest.mark.parametrize("known", [None, LOAD], ids=["no payload known", "a payload known"])
def test_a_payload_is_proposed_only_for_a_nominal_arm_without_one(tmp_path, known):
    data = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    data["robot"] = {"kind": "panda", "plant": {"load": LOAD}, "nominal": {"load": known}}
    data["uncertainty"] = {"robot.plant.load.mass": {"between": [0.8, 1.0]}}
    data["start"] = {"q": data["trajectory"]["waypoints"][0]}
    path = tmp_path / "load.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    problem = read_problem(path)
    space: Any = SimpleNamespace(base=problem.scenario(template(0.3)))
    proposed = [changes for _, changes in refusal._known_payload(problem, space)]
    assert proposed == ([] if known else [{"robot.nominal.load": {**LOAD, "mass": 0.9}}])


@pytest.mark.full
def test_a_start_far_from_the_motion_is_refused_as_it_has_no_tracking_bound(tmp_path):
    data = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    data["start"] = {"q": [0.045, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]}
    path = tmp_path / "far.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    done = in_process("design", str(path), "--out", str(tmp_path / "arm.yaml"), "--json", code=4)
    answer = json.loads(done.stdout)
    assert answer["designed"] is False and "`tracking_bound` gives none" in answer["reason"]
    assert answer["would_do"][-1]["set"] == {"requirements.proof": "tested"}


def test_certified_radii_widen_the_envelope_until_the_bound_holds():
    tried = []

    def verdict_of(law: DesignPoint) -> Verdict:
        tried.append(law.final[0])
        return Verdict("tracking_bound", "", bool(law.final[0] > 2.5e-3), None, {}, (), "")

    law, verdict = certified_radii(LAW, verdict_of, np.full(2, 5e-3))
    assert verdict.holds and np.allclose(law.final, [2.8e-3, 5e-3]) and len(tried) == 4
    assert certified_radii(LAW, verdict_of, np.full(2, 2.2e-3)) is None


@pytest.mark.full
def test_a_design_along_a_motion_has_a_tracking_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(search, "GENERATIONS", 2)
    done = in_process("design", str(FILE), "--out", str(tmp_path / "arm.yaml"), "--json", "--runs", "10")
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["proof"] == "bound"
    certificates = {each["name"]: each for each in answer["certificates"]}
    assert certificates["tracking_bound"]["holds"] is True
