from slidax import scenarios

from .commands import in_process


def test_a_ready_robot_becomes_a_file_that_is_valid(tmp_path):
    out = tmp_path / "mine.yaml"
    in_process("new", "--robot", "panda", "--rate", "500", "--out", str(out), code=0)
    assert scenarios.load(out).period == 0.002
    again = in_process("new", "--robot", "panda", "--out", str(out), code=2)
    assert "exists already" in again.output


def test_scenario_without_a_file_is_printed():
    assert in_process("new", "--robot", "panda").output.startswith("title: panda")
