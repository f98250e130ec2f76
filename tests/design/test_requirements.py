"""Requirements: what a file may say, and the one line for each mistake."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from ruamel.yaml import YAML

from slidax import DefinitionError
from slidax.design import read_problem

EXAMPLES = Path(__file__).parents[2] / "examples" / "design"


def changed(folder: Path, **changes: Any) -> Path:
    """The two-link example with other blocks; None takes one away."""
    data = YAML(typ="safe").load((EXAMPLES / "two-link.yaml").read_text(encoding="utf-8"))
    data = {key: value for key, value in {**data, **changes}.items() if value is not None}
    path = folder / "requirements.yaml"
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(data, file)
    return path


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"trajectory": None}, "needs either `trajectory` or `workspace`"),
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
def test_each_mistake_is_one_line_with_its_path(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        read_problem(changed(tmp_path, **changes))
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_workspace_becomes_a_motion_within_its_range_speed_and_acceleration(tmp_path: Path) -> None:
    speed, acceleration = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    space = {"q": {"low": [0, -1], "high": [2, 1]}, "speed": speed.tolist(), "acceleration": acceleration.tolist()}
    path = changed(tmp_path, trajectory=None, workspace=space, start=None)
    moved = read_problem(path).blocks()["trajectory"]
    amplitude, frequency = np.array(moved["amplitude"]), np.array(moved["frequency"])
    assert np.all(np.abs(np.array(moved["offset"]) - [1, 0]) + amplitude <= 1.0)
    used = np.maximum(amplitude * frequency / speed, amplitude * frequency**2 / acceleration)
    assert np.all(used <= 1.001) and np.all(used > 0.7)


def test_without_a_start_the_arm_begins_on_its_motion(tmp_path: Path) -> None:
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


def test_a_workspace_of_an_arm_without_limits_needs_its_range(tmp_path: Path) -> None:
    path = changed(tmp_path, trajectory=None, workspace={"speed": 1.0, "acceleration": 1.0})
    with pytest.raises(DefinitionError, match=r"workspace\.q: this robot has no limits of its own"):
        read_problem(path).blocks()
