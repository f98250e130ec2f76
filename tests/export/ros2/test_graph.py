import pytest

from benchmarks.targets import ros2
from slidax import scenarios
from slidax.export.ros2 import export_ros2
from tests.export.exported import needs_a_compiler, quickly_compiled


@needs_a_compiler
@pytest.mark.skipif(ros2.python() is None, reason="no environment .venv-ros with rclpy (docs/ros2.md)")
def test_the_ros2_node_answers_every_joint_state_and_completes_a_trajectory(tmp_path):
    scenario = scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}})
    export_ros2(scenario, tmp_path, name="law", golden=False)
    quickly_compiled(tmp_path / "law")
    text = ros2.exchanged(tmp_path, 2300)
    node = (tmp_path / "node.txt").read_text()
    assert text["received"] == text["sent"] == 2300, (text, node)
    assert text["off"] < 0.02, (text, node)
    assert text["told"] >= 2290
    signals = text["signals"]
    assert signals["status"] == [0.0] and len(signals["error"]) == len(signals["tau"]) == 2
    assert 0.0 < signals["margin"][0] <= 1.0
