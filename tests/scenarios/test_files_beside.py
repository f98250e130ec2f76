"""Files that a scenario names are found from its own folder, whichever the command is run in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError

URDF = """<robot name="one">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
</robot>"""

SCENARIO = """
title: One joint from a file beside this one
robot: {kind: urdf, file: arms/one.urdf}
trajectory: {kind: csv, file: motions/turn.csv}
start: {q: [0.0]}
scheme: {name: computed_torque}
simulation: {mode: held, period: 1.0e-2, t1: 0.5}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in {
        "task/arms/one.urdf": URDF,
        "task/motions/turn.csv": "time,shoulder\n0,0\n0.25,0.1\n0.5,0.2\n",
        "task/one.yaml": SCENARIO,
        "elsewhere/arms/one.urdf": URDF.replace('mass value="2"', 'mass value="3"'),
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def mass(scenario: scenarios.Scenario) -> float:
    return float(np.asarray(scenario.plant.robot.masses)[0])


def test_files_are_found_from_the_folder_of_the_scenario(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "elsewhere")
    assert mass(scenarios.load(folder / "task" / "one.yaml")) == 2.0
    assert mass(scenarios.load(Path("..") / "task" / "one.yaml")) == 2.0


def test_a_file_that_is_set_is_found_from_the_current_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "elsewhere")
    changed = scenarios.load(folder / "task" / "one.yaml", {"robot.file": "arms/one.urdf"})
    assert mass(changed) == 3.0


def test_a_file_that_is_not_there_is_named_with_its_folder(folder: Path) -> None:
    (folder / "task" / "arms" / "one.urdf").unlink()
    with pytest.raises(DefinitionError, match=r"^robot: .*task/arms/one.urdf"):
        scenarios.load(folder / "task" / "one.yaml")
