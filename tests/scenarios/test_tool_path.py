"""A path of the tool in a scenario file."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.motions import Circle, Line, follow
from slidax.scenarios import load, parse
from slidax.scenarios.load import portable_text, restore
from slidax.scenarios.yaml_text import as_yaml
from tests.arms.kinematics.postures import home

TEXT = """
title: A circle
robot: {kind: panda}
trajectory:
  kind: tool_path
  start: %s
  velocity: robot
  acceleration: 7
  moves:
    - {kind: line, by: [0.05, 0, 0]}
    - {kind: circle, center: [0.357, 0.1, 0.59], axis: [0, 0, 1], speed: 0.2, acceleration: 1.0}
start: {q: %s}
scheme:
  name: cftsmppc
  performance: {kind: fixed_time, initial: 0.1, final: 0.01, deadline: 1.0, exponent: 2.01}
  overshoot: 0.5
  sampled_data: {}
simulation: {period: 1e-3, t1: 0.02}
""" % ((home("panda").tolist(),) * 2)


def test_it_is_the_motion_that_python_finds_and_can_be_written_again():
    built = parse(TEXT).build("circle")
    arm = built.plant.robot
    found = follow(
        arm,
        [Line(by=[0.05, 0, 0]), Circle(center=[0.357, 0.1, 0.59], axis=[0, 0, 1], speed=0.2, acceleration=1.0)],
        start=home("panda"),
        velocity=np.asarray(arm.limits.velocity),
        acceleration=7.0,
    )
    np.testing.assert_array_equal(built.trajectory.coefficients, found.trajectory.coefficients)
    again = parse(as_yaml(built.description)).build("again")
    np.testing.assert_array_equal(again.trajectory.coefficients, found.trajectory.coefficients)
    assert built.simulate().outcome.ok


def test_a_table_of_poses_travels_with_the_scenario(tmp_path):
    place = [0.3070195700, 0.0, 0.5902695582]
    rows = "\n".join(f"{t},{place[0]},{y},{place[2]}" for t, y in ((0, 0), (0.5, 0.02), (1, 0.05)))
    (tmp_path / "tool.csv").write_text(f"time,x,y,z\n{rows}\n")
    before, after = TEXT.split("  velocity")[0], TEXT[TEXT.index("start: {q") :]
    (tmp_path / "one.yaml").write_text(f"{before}  file: tool.csv\n{after}")
    built = load(tmp_path / "one.yaml")
    there = built.plant.robot.tip(built.trajectory.position(jnp.asarray(1.0)))
    np.testing.assert_allclose(there, [place[0], 0.05, place[2]], atol=1e-6)
    again = restore(*portable_text(built.description), "again")
    np.testing.assert_array_equal(again.trajectory.coefficients, built.trajectory.coefficients)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"trajectory.moves": []}, "trajectory: needs one of `moves`, `file` and `text`"),
        ({"trajectory.start": [0.0, 1.0]}, "trajectory: `start` must be 7 finite numbers"),
        ({"trajectory.velocity": 0.01}, "trajectory.moves.1: panda_joint"),
        ({"trajectory.moves.0.kind": "spiral"}, "trajectory.moves.0"),
        ({"trajectory.hold": "all"}, "trajectory.hold"),
        ({"robot": {"kind": "panda"}, "trajectory.moves.0.by": [1, 0, 0]}, "moves.0: the tool cannot follow beyond"),
    ],
)
def test_what_is_wrong_is_said_with_its_path(changes, said):
    with pytest.raises(DefinitionError, match=said):
        parse(TEXT, changes).build("wrong")
