"""Arms from URDF files, by slidax and by MuJoCo's own dynamics."""

from __future__ import annotations

import time

import pytest

from slidax.arms.files.reading import reading
from tests.peers.arms import ARMS, Arm, cases
from tests.peers.by_mujoco import by_mujoco, mujoco
from tests.peers.motion import assert_same, by_slidax, random_states


def model_of(arm: Arm):
    """As MuJoCo reads it, but without shapes, whose meshes it would need, and without joining what is fixed."""
    with reading():
        spec = mujoco.MjSpec.from_file(arm.path)
        for shape in (*spec.geoms, *spec.meshes):
            spec.delete(shape)
        spec.compiler.fusestatic = False
        return spec.compile()


@pytest.mark.parametrize(("arm", "count"), cases())
def test_an_arm_from_urdf_moves_as_mujoco_says(arm, count):
    robot = arm.read()
    states = random_states(robot, count)
    theirs = by_mujoco(model_of(arm), arm.tip, robot.joint_names, states, arm.locked)
    assert_same(by_slidax(robot, states), theirs)


def test_a_panda_with_its_meshes_is_read_within_a_second():
    start = time.perf_counter()
    ARMS[0].read()
    assert time.perf_counter() - start < 1.0
