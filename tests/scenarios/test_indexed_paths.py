"""One number of a list, by the name of its joint or its place from 0."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from slidax.core.errors import DefinitionError
from slidax.scenarios import load
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description, read_description
from slidax.scenarios.uncertainty import Uncertainty
from tests.cli.commands import in_process

PANDA = read_description("panda-payload")


@pytest.mark.parametrize("path", ["start.q[3]", "start.q[panda_joint4]", "start.q[Panda-Joint4]", "start.q.3"])
def test_one_joint_is_set_by_its_name_or_its_place(path: str) -> None:
    changed = alter_description(PANDA, {path: -1.75})
    expected = list(PANDA.start.q)
    expected[3] = -1.75
    assert changed.start.q == expected


def test_one_number_for_all_joints_becomes_one_for_each() -> None:
    changed = alter_description(PANDA, {"scheme.k1": 0.5, "scheme.k1[panda_joint2]": 0.25})
    assert changed.scheme.surface.k1 == [0.5, 0.25, *[0.5] * 5]


def test_numbered_joints_are_named_by_their_numbers_from_1() -> None:
    scenario = load("example-4.1", {"start.q[joint 2]": 2.25, "start.q[0]": 0.05, "simulation.t1": 0.1})
    np.testing.assert_array_equal(scenario.state0.q, [0.05, 2.25])


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("start.q[7]", "`start.q` is a list of 7; `7` is not one of its numbers from 0"),
        ("start.q.panda_joint4", "is not one of its numbers from 0. Write `start.q[0]`, or `start.q[JOINT]`"),
        ("start.q[panda_joint]", "`panda_joint` is no joint of the robot, and no number from 0 to 6; did you mean"),
        ("start.q[-1]", "`-1` is no joint of the robot, and no number from 0 to 6"),
        ("start.q[", "is no path: a place in a list has the form"),
        ("start.q[0]]", "is no path: a place in a list has the form"),
        ("start.dq[0]", "`start.dq` is not in the file, so that one of its numbers cannot be set: set all"),
        ("start[0]", "start: unknown key `0`"),
        ("start.q[0][1]", "`start.q.0` is a single value"),
    ],
)
def test_a_place_that_is_none_is_refused_with_those_that_are(path: str, words: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        alter_description(PANDA, {path: 0.1})
    assert words in str(caught.value)


def test_the_command_line_takes_brackets() -> None:
    result = in_process("run", "example-4.1", "--set", "start.q[0]=0.05", "--set", "simulation.t1=0.01", "--json")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("path", "column", "label"),
    [
        ("start.q", "start.q[3]", "start.q[panda_joint4]"),
        ("start.q[panda_joint4]", "start.q.3", "start.q[panda_joint4]"),
        ("robot.plant.coulomb", "robot.plant.coulomb[0]", "robot.plant.coulomb[panda_joint1]"),
        ("robot.plant.load.center", "robot.plant.load.center[2]", "robot.plant.load.center[2]"),
    ],
)
def test_a_label_names_the_joint_and_can_be_set(path: str, column: str, label: str) -> None:
    sets: Any = TypeAdapter(Uncertainty).validate_python({path: {"around": 0.01, "each": "joint"}})
    family = Family.of(PANDA, sets)
    assert family.label(column) == label
    alter_description(PANDA, {"robot.plant.coulomb": [0.5] * 7, label: 0.1})
