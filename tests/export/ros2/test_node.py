from types import SimpleNamespace

import pytest

from slidax.export.onboard.ros2_node import Node


class FakeRos:
    def __init__(self):
        self.lines = []

    def create_publisher(self, *_):
        return None

    def create_subscription(self, *_):
        return None

    def get_logger(self):
        return SimpleNamespace(error=self.lines.append, warning=self.lines.append)


@pytest.fixture
def node():
    pilot = SimpleNamespace(options=SimpleNamespace(follows=False, path=SimpleNamespace(hold=1.0)), taken=[])
    pilot.take = lambda times, q, dq, ddq: pilot.taken.append((times, q, dq, ddq))
    law = SimpleNamespace(pilot=lambda: pilot)
    node = Node(FakeRos(), law, ["left-arm/shoulder", "left-arm/elbow"], [None] * 4)
    # A joint state has come.
    node.before = 0.0
    return node


def message(names, *rows):
    points = [
        SimpleNamespace(
            positions=row,
            velocities=[10 * q for q in row],
            accelerations=[],
            time_from_start=SimpleNamespace(sec=k, nanosec=0),
        )
        for k, row in enumerate(rows)
    ]
    return SimpleNamespace(joint_names=names, points=points)


def test_trajectory_joints_are_matched_by_name_and_unknown_joints_ignored_with_a_warning(node):
    node.wanted(message(["finger", "left-arm/elbow", "left-arm/shoulder"], [0.04, 1.0, 2.0]))
    assert node.pilot.taken == [([0.0], [[2.0, 1.0]], [[20.0, 10.0]], None)]
    assert node.ros.lines == ["trajectory joints unknown to the law are ignored: finger"]


@pytest.mark.parametrize(
    ("names", "word"),
    [
        (["left-arm/shoulder", "elbow"], "joint left-arm/elbow once; its joints are left-arm/shoulder, elbow"),
        (["left-arm/shoulder"] * 2, "it must have the joint left-arm/shoulder once"),
    ],
)
def test_a_missing_or_doubled_joint_is_refused_by_name(node, names, word):
    node.wanted(message(names, [0.0, 0.0]))
    assert not node.pilot.taken and word in node.ros.lines[0]


def test_a_trajectory_before_the_first_joint_state_is_refused(node):
    node.before = None
    node.wanted(message(node.joints, [0.0, 0.0]))
    assert not node.pilot.taken
    assert node.ros.lines == ["trajectory rejected: no joint state has come yet; send it again after the first one"]


def test_a_trajectory_after_a_stop_is_refused_with_the_reason_of_the_stop(node):
    node.ended, node.pilot.why = True, "a joint exceeds its speed limit (joint 2)"
    node.wanted(message(node.joints, [0.0, 0.0]))
    assert not node.pilot.taken and "the law has stopped: a joint exceeds its speed limit" in node.ros.lines[0]
