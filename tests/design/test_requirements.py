"""Requirement files and the scenario files of designs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from ruamel.yaml import YAML

from slidax import DefinitionError
from slidax.certify import Assumption, Verdict
from slidax.design import DesignResult, read_problem
from slidax.design.candidates import DesignPoint, DesignSpace, template
from slidax.design.design import design_text
from slidax.scenarios import load, parse
from tests.design.test_search import worst

EXAMPLES = Path(__file__).parents[2] / "examples" / "design"


def changed(folder: Path, **changes: Any) -> Path:
    """The two-link example with changed blocks; None removes a block."""
    data = YAML(typ="safe").load((EXAMPLES / "two-link.yaml").read_text(encoding="utf-8"))
    data = {key: value for key, value in {**data, **changes}.items() if value is not None}
    path = folder / "requirements.yaml"
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(data, file)
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory": None}, "one of the blocks `trajectory` and `workspace`"),
        ({"requirement": {}}, "unknown key `requirement`; did you mean `requirements`"),
        ({"requirements": {"accuracy": -1}}, "requirements.accuracy: must be > 0, or `best`"),
        (
            {"requirements": {"accuracy": [1e-3]}},
            "requirements.accuracy: must be one number or one for each of the 2 joints",
        ),
        ({"requirements": {"deadline": 0}}, "requirements.deadline: must be > 0"),
        ({"simulation": {"period": 1e-3, "t1": 1.5}}, "simulation.t1: must be after the deadline"),
        ({"simulation": {}}, "simulation.period: is missing"),
    ],
)
def test_invalid_requirements_are_refused_in_one_line_with_their_path(tmp_path, changes, message):
    with pytest.raises(DefinitionError) as caught:
        read_problem(changed(tmp_path, **changes))
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_a_workspace_becomes_a_motion_within_its_range_speed_and_acceleration(tmp_path):
    speed, acceleration = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    space = {"q": {"low": [0, -1], "high": [2, 1]}, "speed": speed.tolist(), "acceleration": acceleration.tolist()}
    path = changed(tmp_path, trajectory=None, workspace=space, start=None)
    moved = read_problem(path).blocks()["trajectory"]
    amplitude, frequency = np.array(moved["amplitude"]), np.array(moved["frequency"])
    assert np.all(np.abs(np.array(moved["offset"]) - [1, 0]) + amplitude <= 1.0)
    used = np.maximum(amplitude * frequency / speed, amplitude * frequency**2 / acceleration)
    assert np.all(used <= 1.001) and np.all(used > 0.7)


def test_without_a_start_the_arm_begins_on_its_motion(tmp_path):
    problem = read_problem(changed(tmp_path, start=None))
    built = problem.scenario(
        {
            "name": "cftsmppc",
            "performance": {"kind": "fixed_time", "initial": 1, "final": 0.1, "deadline": 1, "exponent": 2.01},
            "overshoot": 0.9,
            "sampled_data": {},
        }
    ).moving()
    reference = built.trajectory.reference(jnp.zeros(()))
    assert np.allclose(built.state0.q, reference.q) and np.allclose(built.state0.dq, reference.dq)


def test_a_workspace_without_position_range_is_refused_for_an_arm_without_limits(tmp_path):
    path = changed(tmp_path, trajectory=None, workspace={"speed": 1.0, "acceleration": 1.0})
    with pytest.raises(DefinitionError, match=r"workspace\.q: this robot has no position limits"):
        read_problem(path).blocks()


def result_of(folder: Path, along: bool = False, **other: Any) -> DesignResult:
    problem = read_problem(changed(folder))
    two = np.ones(2)
    base = problem.scenario(template(2.0))
    space = DesignSpace(base, two, two, 60.0 * two, 60.0 * two, 1e-3, 1.0, False, 4.0 * two, along=along)
    choice = replace(DesignPoint(0.009, 1.0, 2.0, np.array([2e-3, 3e-3]), 2.0, margin=12.5), **other)
    described = space.described(choice)
    check = {"runs": 128, "failures": 0, "searched": 128, "worst_margin": 0.2}
    verdict = Verdict("statistical", "", True, 0.2, check, (), "")
    return DesignResult(described, "tested", space, choice, worst(1e-4, 0.1), None, None, verdict, 0)


def test_a_design_file_loads_with_the_values_of_the_chosen_design(tmp_path):
    result = result_of(tmp_path)
    text = design_text(result, tmp_path)
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
        {"along": True},
        {"drift": None, "gain": 0.7},
        {"margin": None, "even": 0.4, "horizon": 0.00912345678, "overshoot": 0.912345678},
    ],
    ids=["learning", "with a bound", "with a velocity sensor's estimator", "with numbers of many digits"],
)
def test_the_law_in_the_design_file_is_the_law_that_was_checked(tmp_path, law):
    result = result_of(tmp_path, **law)
    read = parse(design_text(result, tmp_path), folder=tmp_path)
    text, checked = (item.model_dump(mode="json", exclude_unset=True) for item in (read, result.description))
    assert text["scheme"] == checked["scheme"] and text == checked


def test_a_design_file_reads_certified_only_if_all_assumptions_are_proved(tmp_path):
    result = result_of(tmp_path)
    assert "# Tested in simulation, not proved" in design_text(result, tmp_path)
    assert "Certified" not in design_text(result, tmp_path)
    stands_on = [Assumption("", item) for item in ("proved", "tested", "assumed", "assumed")]
    bound = Verdict("tracking_bound", "", True, 0.2, {}, stands_on, "")
    text = " ".join(design_text(replace(result, proof="bound", bound=bound), tmp_path).replace("#", "").split())
    assert "Tested, with a bound of `tracking_bound`, grade B: its lines: 1 proved, 1 tested, 2 assumed" in text
    assert "ertified" not in text
    bound = Verdict("tracking_bound", "", True, 0.2, {}, stands_on[:1], "")
    assert "# Certified by `tracking_bound`, grade A" in design_text(
        replace(result, proof="bound", bound=bound), tmp_path
    )


def test_a_design_file_without_a_bound_names_the_option_proof_bound(tmp_path):
    text = " ".join(design_text(result_of(tmp_path), tmp_path).replace("#", "").split())
    assert "not proved: the law learns, and `proof: bound` looks for a law with a bound." in text
