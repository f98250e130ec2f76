"""A controller that takes only goals inside the guarantee of its law."""

import re

import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.export.ros2 import export_ros2
from tests.certify.motion.test_paper_arms import NEAR
from tests.export.exported import needs_a_compiler, needs_cmake
from tests.export.ros2.test_controller import parameters_of, programs_of

pytestmark = [needs_a_compiler, needs_cmake]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("guarantee")
    export_ros2(scenarios.load("example-4.1-1khz", NEAR), folder, name="law", golden=False, admission=True)
    return folder


@pytest.fixture(scope="module")
def lines(package):
    return [line.split(": ", 1) for line in programs_of(package)("guarantee")]


@pytest.mark.full
def test_goals_inside_the_guarantee_arrive_with_errors_within_it(lines):
    as_they_are, slowed = lines[:5], lines[9:14]
    for part, goals in ((as_they_are, 12), (slowed, 4)):
        counts = {name: float(number) for name, number in part}
        assert counts["taken"] + counts["refused"] == goals and counts["taken"] >= 3 and counts["wrong"] == 0
        assert 0.0 < counts["error"] <= 1.4e-4
    assert dict(as_they_are)["refused"] != "0" and dict(as_they_are)["slowed"] == "0" and dict(slowed)["slowed"] != "0"


@pytest.mark.full
@pytest.mark.parametrize(
    ("goal", "result"),
    [
        ("fast", r"-1 the guaranteed error is too large; joint `joint_\d`: .* after .* s, allowed 0.00014"),
        (
            "in a motion",
            "-1 the guarantee is of trajectories from rest: send it .* s after the arm came to rest, or .*",
        ),
        ("goes on", "99 "),
        ("arrived", "0 "),
        ("other gains", "-1 the guarantee is of the law as exported: reset `law.kp`, .*"),
        ("not required", "99 "),
    ],
)
def test_a_goal_is_accepted_or_refused_by_the_guarantee_with_a_reason(lines, goal, result):
    assert re.fullmatch(result, dict(lines)[goal]), dict(lines)[goal]


@pytest.mark.full
def test_the_guarantee_is_required_by_default_and_assumes_no_torque_steps(package):
    rows = parameters_of(package)["slidax_law_controller"]["guarantee"]
    assert rows["required"]["default_value"] is True and rows["assume_steps"]["default_value"] is False


def test_a_guarantee_is_refused_if_the_robot_compensates_gravity(tmp_path):
    with pytest.raises(DefinitionError, match="--gravity law"):
        export_ros2(scenarios.load("example-4.1-1khz", NEAR), tmp_path, gravity="robot", admission=True)
