"""Trajectories within limits and from files, as a scenario names them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from slidax import scenarios
from slidax.arms import JointLimits
from slidax.core.errors import DefinitionError
from slidax.motions import AbstractMotion, MinimumJerk, Tabulated, Trapezoidal
from slidax.scenarios.trajectories import TrajectoryDescription
from slidax.scenarios.yaml_text import read_yaml

PATH = [[-0.4, 2.5], [0.2, 2.0], [0.1, 2.2]]
CSV = "time,elbow,shoulder\n0,2.5,-0.4\n1,2.0,0.2\n2.5,2.2,0.1\n"
MESSAGE = {
    "joint_names": ["elbow", "shoulder"],
    "points": [
        {"positions": [2.5, -0.4], "time_from_start": {"sec": 0, "nanosec": 0}},
        {"positions": [2.0, 0.2], "time_from_start": {"sec": 1, "nanosec": 0}},
        {"positions": [2.2, 0.1], "time_from_start": {"sec": 2, "nanosec": 500_000_000}},
    ],
}
ARM = ["shoulder", "elbow"]
LIMITS = JointLimits([-1.0, -0.1], [3.0, 3.0], [2.0, 1.5], [np.inf, np.inf], [np.inf, np.inf])
THROUGH = Tabulated.through([0.0, 1.0, 2.5], PATH)
TABLE = Tabulated(THROUGH.times, THROUGH.coefficients, ("shoulder", "elbow"))


def described(trajectory: dict[str, Any]) -> Any:
    return TypeAdapter(TrajectoryDescription).validate_python(trajectory)


def loaded(trajectory: dict[str, Any], **changes: Any) -> Any:
    return scenarios.load("example-4.1", {"trajectory": trajectory, "simulation.t1": 0.1} | changes)


CASES: list[tuple[dict[str, Any], AbstractMotion]] = [
    (
        {"kind": "quintic", "waypoints": PATH, "velocity": 1.0, "acceleration": [3.0, 4.0]},
        MinimumJerk.within(PATH, velocity=1.0, acceleration=[3.0, 4.0]),
    ),
    (
        {"kind": "quintic", "waypoints": PATH, "velocity": 1.0, "acceleration": 3.0, "jerk": 50.0, "start": 0.5},
        MinimumJerk.within(PATH, velocity=1.0, acceleration=3.0, jerk=50.0, start=0.5),
    ),
    (
        {"kind": "trapezoidal", "waypoints": PATH, "velocity": [1.0, 2.0], "acceleration": 3.0},
        Trapezoidal.through(PATH, velocity=[1.0, 2.0], acceleration=3.0),
    ),
    (
        {"kind": "trapezoidal", "waypoints": PATH, "velocity": 1.0, "acceleration": 3.0, "jerk": 50.0, "start": 0.5},
        Trapezoidal.through(PATH, velocity=1.0, acceleration=3.0, jerk=50.0, start=0.5),
    ),
    ({"kind": "csv", "text": CSV, "joints": ARM, "velocity": 2.0}, TABLE),
    ({"kind": "joint_trajectory", "text": json.dumps(MESSAGE), "joints": ARM, "acceleration": [30, 30]}, TABLE),
]


@pytest.mark.parametrize(("trajectory", "expected"), CASES, ids=[str(number) for number in range(len(CASES))])
def test_a_scenario_names_the_motion_that_python_makes(trajectory: dict[str, Any], expected: AbstractMotion) -> None:
    scenario = loaded(trajectory)
    assert eqx.tree_equal(scenario.trajectory, expected, rtol=1e-12, atol=1e-12)
    assert scenario.simulate(log_every=None).outcome.kind in ("ok", "left_envelope")


@pytest.mark.parametrize(("kind", "content"), [("csv", CSV), ("joint_trajectory", json.dumps(MESSAGE))])
def test_a_file_is_named_from_the_current_directory(
    kind: str, content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "motion.txt").write_text(content, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    built = loaded({"kind": kind, "file": "motion.txt", "joints": ARM}).trajectory
    assert eqx.tree_equal(built, TABLE, rtol=1e-12, atol=1e-12)
    with pytest.raises(DefinitionError, match=r"^trajectory: cannot read the file `gone.txt`"):
        loaded({"kind": kind, "file": "gone.txt"})


def test_the_word_robot_stands_for_the_limits_of_the_robot() -> None:
    quintic = described({"kind": "quintic", "waypoints": PATH, "velocity": "robot", "acceleration": 30.0})
    assert eqx.tree_equal(
        quintic.build(LIMITS), MinimumJerk.within(PATH, velocity=[2.0, 1.5], acceleration=30.0), rtol=1e-12, atol=1e-12
    )
    fast = described({"kind": "trapezoidal", "waypoints": PATH, "velocity": "robot", "acceleration": 30.0})
    both = Trapezoidal.through(PATH, velocity=[2.0, 1.5], acceleration=30.0)
    assert eqx.tree_equal(fast.build(LIMITS), both, rtol=1e-12, atol=1e-12)
    table = {"kind": "csv", "text": CSV, "joints": ARM, "lower": "robot", "upper": "robot", "velocity": "robot"}
    assert eqx.tree_equal(described(table).build(LIMITS), TABLE)
    low = eqx.tree_at(lambda limits: limits.upper, LIMITS, np.array([0.1, 3.0]))
    with pytest.raises(DefinitionError, match=r"joint `shoulder` would go to .* above its limit of 0.1"):
        described(table).build(low)


def test_a_robot_without_limits_has_none_to_take() -> None:
    quintic = described({"kind": "quintic", "waypoints": PATH, "velocity": "robot", "acceleration": 30.0})
    with pytest.raises(DefinitionError, match="velocity: says `robot`, but this robot has no limits of its own"):
        quintic.build()


@pytest.mark.parametrize(
    ("trajectory", "words"),
    [
        ({"kind": "csv"}, "trajectory: needs either `file` or `text`"),
        ({"kind": "csv", "file": "a.csv", "text": CSV}, "trajectory: needs either `file` or `text`"),
        ({"kind": "joint_trajectory", "text": "joint_names: []"}, r"trajectory\.text: must be a JSON object"),
        (
            {"kind": "csv", "text": "time,joint 2,joint 1\n0,1,0\n1,1,x"},
            "trajectory: the text, line 3, column `joint 1`: `x` is not a number",
        ),
        ({"kind": "csv", "text": "time,a\n0,0\n1,1"}, "trajectory: the text moves 1 joint, `a`, but the robot has 2"),
        (
            {"kind": "csv", "text": CSV, "joints": ["elbow"]},
            r"trajectory\.joints: must have one name for each of the robot's 2 joints, `joint 1`, `joint 2`; got 1",
        ),
        (
            {"kind": "csv", "text": "time,joint 1,joint 2\n0,0,0\n1,0,0", "joints": ["joint 2", "joint 1"]},
            r"trajectory\.joints: `joint 1` stands in the place of the robot's joint `joint 2`",
        ),
        (
            {"kind": "quintic", "waypoints": PATH, "velocity": "fast", "acceleration": 1.0},
            r"trajectory\.velocity: must be a number or a list of numbers; got 'fast'",
        ),
        (
            {"kind": "trapezoidal", "waypoints": PATH, "velocity": 1.0, "acceleration": -1.0},
            "trajectory: `Trapezoidal.acceleration` must be > 0; got -1 for joint 1",
        ),
        ({"kind": "trapezoidal", "waypoints": PATH, "velocity": 1.0}, r"trajectory\.acceleration: is missing"),
    ],
)
def test_what_is_wrong_is_one_sentence_with_its_path(trajectory: dict[str, Any], words: str) -> None:
    with pytest.raises(DefinitionError, match=words):
        loaded(trajectory)


def test_a_text_can_stand_in_the_file_itself() -> None:
    text = "kind: csv\njoints: [shoulder, elbow]\ntext: |\n  " + CSV.replace("\n", "\n  ")
    assert eqx.tree_equal(described(read_yaml(text)).build(), TABLE)


def test_an_unknown_key_is_refused() -> None:
    with pytest.raises(ValidationError, match="unknown key `velocty`"):
        described({"kind": "csv", "text": CSV, "velocty": 1.0})
