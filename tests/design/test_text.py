"""The file of a design: it is a scenario, says what is proved, and finds the arm's file from where it lies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.certify import Assumption, Verdict
from slidax.design import DesignResult, read_problem
from slidax.design.candidates import DesignPoint, DesignSpace, template
from slidax.design.design import written
from slidax.scenarios import load, parse

from .test_requirements import changed
from .test_search import worst


def made(folder: Path, learns: bool = True, **other: Any) -> DesignResult:
    problem = read_problem(changed(folder))
    two = np.ones(2)
    base = problem.scenario(template(2.0))
    frame = DesignSpace(base, two, two, 60.0 * two, 60.0 * two, 1e-3, 1.0, False, 4.0 * two, learns=learns)
    choice = replace(DesignPoint(0.009, 1.0, 2.0, np.array([2e-3, 3e-3]), 2.0, margin=12.5), **other)
    described = frame.described(choice)
    check = {"runs": 128, "failures": 0, "searched": 128, "worst_margin": 0.2}
    verdict = Verdict("statistical", "", True, 0.2, check, (), "")
    return DesignResult(described, "tested", frame, choice, worst(1e-4, 0.1), None, None, verdict, 0)


def test_it_runs_as_it_is_with_the_numbers_of_the_choice(tmp_path: Path) -> None:
    result = made(tmp_path)
    text = written(result, tmp_path)
    (tmp_path / "law.yaml").write_text(text, encoding="utf-8")
    scenario = load(tmp_path / "law.yaml")
    law = scenario.controller
    assert float(law.horizon) == 0.009 and law.monitor is not None
    assert np.allclose(law.step.transformation.performance.final, [2e-3, 3e-3])
    assert np.isclose(law.step.surface.k1, 1.0)
    assert scenario.description.uncertainty.keys() == result.description.uncertainty.keys()
    assert float(law.step.bound.margin) == 12.5


@pytest.mark.parametrize(
    "law",
    [
        {},
        {"learns": False},
        {"drift": None, "gain": 0.7},
        {"margin": None, "even": 0.4, "horizon": 0.00912345678, "overshoot": 0.912345678},
    ],
    ids=["learning", "not learning", "with a velocity sensor's estimator", "with numbers of many digits"],
)
def test_the_law_in_the_file_is_the_law_that_was_checked(tmp_path: Path, law: dict[str, Any]) -> None:
    result = made(tmp_path, **law)
    read = parse(written(result, tmp_path), folder=tmp_path)
    text, checked = (item.model_dump(mode="json", exclude_unset=True) for item in (read, result.description))
    assert text["scheme"] == checked["scheme"]
    assert text == checked


def test_a_law_is_certified_only_where_all_lines_are_proved_and_else_tested(tmp_path: Path) -> None:
    result = made(tmp_path)
    assert "# Tested in simulation, not proved" in written(result, tmp_path)
    assert "Certified" not in written(result, tmp_path)
    stands_on = [Assumption("", item) for item in ("proved", "tested", "assumed", "assumed")]
    rate = Verdict("loop_rate", "", True, 0.2, {}, stands_on, "")
    text = " ".join(written(replace(result, proof="bound", rate=rate), tmp_path).replace("#", "").split())
    assert "Tested, with a bound of `loop_rate`, grade B: its lines: 1 proved, 1 tested, 2 assumed" in text
    assert "ertified" not in text
    rate = Verdict("loop_rate", "", True, 0.2, {}, stands_on[:1], "")
    assert "# Certified by `loop_rate`, grade A" in written(replace(result, proof="bound", rate=rate), tmp_path)


def test_of_many_joints_it_names_the_requirement_that_looks_for_a_law_with_a_proof(tmp_path: Path) -> None:
    result = made(tmp_path)
    assert "`loop_rate` has no bound within such an envelope" in written(result, tmp_path)
    four = replace(result.frame, initial=np.ones(4))
    text = " ".join(written(replace(result, frame=four), tmp_path).replace("#", "").split())
    assert "from 4 joints on `loop_rate` has no bound for a law that learns the inertia" in text
    text = written(replace(result, frame=replace(four, learns=False)), tmp_path)
    assert "`loop_rate` has no bound within such an envelope" in text
