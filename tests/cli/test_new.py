import re

import numpy as np
import pytest

from slidax import scenarios
from slidax.design.problem import read_problem
from tests.documentation.pages import ROOT

from .commands import in_process

SMALL_ARM = ROOT / "examples" / "robots" / "small_arm.urdf"


def test_new_writes_a_valid_scenario_of_a_built_in_robot_and_overwrites_no_file(tmp_path):
    out = tmp_path / "mine.yaml"
    in_process("new", "--robot", "panda", "--rate", "500", "--out", str(out), code=0)
    assert scenarios.load(out).period == 0.002
    again = in_process("new", "--robot", "panda", "--out", str(out), code=2)
    assert "exists already" in again.output


def test_new_without_out_prints_the_scenario():
    assert in_process("new", "--robot", "panda").output.startswith("title: panda")


def test_drafted_requirements_are_readable_by_design_and_cover_the_payload(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    arm = SMALL_ARM.read_text(encoding="utf-8")
    (tmp_path / "arm.urdf").write_text(arm, encoding="utf-8")
    answer = in_process(
        "new", "--robot", "arm.urdf", "--payload", "0.4", "--requirements", "--out", "needs.yaml", code=0
    )
    assert "slidax design needs.yaml --out needs-law.yaml" in answer.output
    problem = read_problem(tmp_path / "needs.yaml")
    assert problem.uncertainty["robot.plant.load.mass"].between == [0.0, 0.4]
    arms = problem.robot.build()
    np.testing.assert_allclose(arms.true.armature, 0.002 * np.asarray(arms.nominal.limits.torque))
    assert problem.robot.plant.load.mass == 0.4
    text = " ".join(line.strip("# ") for line in (tmp_path / "needs.yaml").read_text(encoding="utf-8").splitlines())
    assert "load: {center: [x, y, z]} moves it [m]" in text


@pytest.mark.full
def test_drafted_requirements_can_be_designed_and_the_law_runs(tmp_path):
    needs, law = tmp_path / "needs.yaml", tmp_path / "law.yaml"
    in_process("new", "--robot", str(SMALL_ARM), "--payload", "0.4", "--requirements", "--out", str(needs), code=0)
    assert "Designed" in in_process("design", str(needs), "--out", str(law), "--runs", "16", code=0).output
    assert scenarios.load(law).simulate().outcome.ok


def test_a_payload_that_the_drives_cannot_hold_is_refused_with_the_joint():
    answer = in_process("new", "--robot", "panda", "--payload", "30", code=2)
    assert "panda_joint6" in answer.output and "at most 80 % is allowed" in answer.output


def test_a_mounted_arm_has_its_gravity_in_law_and_simulation(tmp_path):
    file = tmp_path / "wall.yaml"
    in_process("new", "--robot", "ur5e", "--gravity", "0,9.81,0", "--out", str(file), code=0)
    scenario = scenarios.load(file)
    for arm in (scenario.controller.nominal, scenario.plant.robot):
        assert arm.gravity_vector.tolist() == [0.0, 9.81, 0.0]
    refused = in_process("new", "--robot", "ur5e", "--gravity", "0,9.81", code=2)
    assert "the gravity must be three numbers" in refused.stderr


def test_impossible_inertias_are_refused_with_strict_and_otherwise_corrected(tmp_path):
    file = tmp_path / "arm.urdf"
    text = SMALL_ARM.read_text(encoding="utf-8")
    file.write_text(re.sub(r'ixx="[^"]*"', 'ixx="100.0"', text, count=2), encoding="utf-8")
    assert "inerti" in in_process("new", "--robot", str(file), "--inertias", "strict", code=2).stderr
    out = tmp_path / "arm.yaml"
    in_process("new", "--robot", str(file), "--out", str(out), code=0)
    assert "inertias: nearest" in out.read_text(encoding="utf-8")
    built_in = in_process("new", "--robot", "panda", "--inertias", "strict", code=2)
    assert "`inertias` are only for robot files" in built_in.stderr


def test_a_locked_joint_is_not_part_of_the_arm(tmp_path):
    pytest.importorskip("mujoco")
    out = tmp_path / "arm.yaml"
    in_process("new", "--robot", str(SMALL_ARM), "--locked", "elbow=0.5", "--out", str(out), code=0)
    scenario = scenarios.load(out)
    assert scenario.controller.nominal.joint_names == ("turntable", "shoulder", "wrist")
    assert scenarios.named_robot(str(out))[0].joint_names == ("turntable", "shoulder", "wrist")
