"""Designs whose error is bounded along a motion that ends at rest."""

import json
from typing import Any

import numpy as np
import pytest
import yaml

from slidax.certify import Verdict
from slidax.design import read_problem, search
from slidax.design.candidates import DesignPoint
from slidax.design.design import _begin
from slidax.design.proof import certified_radii, tracking_verdict
from tests.cli.commands import in_process
from tests.design.test_requirements import EXAMPLES

FILE = EXAMPLES / "panda-along.yaml"
LAW = DesignPoint(0.01, 1.0, 1.0, np.array([1e-3, 2e-3]), 0.3)


def frame_of(folder: Any, **changes: Any) -> Any:
    data = yaml.safe_load(FILE.read_text(encoding="utf-8")) | changes
    path = folder / "asked.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return _begin(read_problem(path))[0]


def test_a_required_bound_makes_a_law_that_tracking_bound_covers(tmp_path):
    frame = frame_of(tmp_path)
    law = frame.described(DesignPoint(0.028, 1.0, 1.0, np.full(7, 0.0125), 0.3)).build("law")
    assert frame.along and law.controller.adaptation is None and law.controller.midpoint
    verdict = tracking_verdict(law)
    assert verdict is not None and verdict.holds is True
    (envelope,) = (line for line in verdict.assumptions if "inside the envelope" in line.text)
    assert envelope.status == "proved"


@pytest.mark.parametrize(
    "changes",
    [
        {"requirements": {"deadline": 0.3, "proof": "tested"}},
        {"trajectory": {"kind": "sinusoid", "offset": [0.1] * 7, "amplitude": [0.1] * 7, "frequency": [1.0] * 7}},
        {"start": {"q": [0.04, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]}},
        {
            "robot": {"kind": "panda", "plant": {"load": {"mass": 1.0, "center": [0.0, 0.0, 0.1]}}},
            "uncertainty": {"robot.plant.load.center": {"around": 0.01, "each": "entry"}},
        },
    ],
    ids=["no bound required", "a motion without an end", "a start far from the motion", "a set that is not covered"],
)
def test_a_law_keeps_its_own_form_where_tracking_bound_has_no_bound(tmp_path, changes):
    assert not frame_of(tmp_path, **changes).along


def test_the_smallest_radii_with_a_verdict_that_holds_are_taken():
    tried = []

    def verdict_of(law: DesignPoint) -> Verdict:
        tried.append(law.final[0])
        return Verdict("tracking_bound", "", bool(law.final[0] > 2.5e-3), None, {}, (), "")

    law, verdict = certified_radii(LAW, verdict_of, np.full(2, 5e-3))
    assert verdict.holds and np.allclose(law.final, [2.8e-3, 5e-3]) and len(tried) == 4
    assert certified_radii(LAW, verdict_of, np.full(2, 2.2e-3)) is None
    assert certified_radii(LAW, lambda _: None, np.full(2, 5e-3)) is None


@pytest.mark.full
def test_a_design_along_a_motion_has_a_proved_envelope(tmp_path, monkeypatch):
    monkeypatch.setattr(search, "GENERATIONS", 2)
    done = in_process("design", str(FILE), "--out", str(tmp_path / "arm.yaml"), "--json", "--runs", "10")
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["proof"] == "bound"
    certificates = {each["name"]: each for each in answer["certificates"]}
    assert certificates["tracking_bound"]["holds"] is True
