"""Arms from URDF files, by slidax and by Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

from tests.peers.arms import ARMS, Arm, cases
from tests.peers.by_pinocchio import by_pinocchio, held, pinocchio
from tests.peers.motion import assert_same, by_slidax, random_states


def model_of(arm: Arm):
    return held(pinocchio.buildModelFromUrdf(arm.path), arm.locked)


@pytest.mark.parametrize(("arm", "count"), cases())
def test_an_arm_from_urdf_moves_as_pinocchio_says(arm, count):
    robot = arm.read()
    states = random_states(robot, count)
    assert_same(by_slidax(robot, states), by_pinocchio(model_of(arm), arm.tip, robot.joint_names, states))


@pytest.mark.parametrize("arm", [arm for arm in ARMS if arm.limits], ids=lambda arm: arm.name)
def test_friction_and_limits_from_urdf_are_those_that_pinocchio_reads(arm):
    robot, model = arm.read(), model_of(arm)
    for i, name in enumerate(robot.joint_names):
        joint = model.joints[model.getJointId(name)]
        assert robot.viscous[i] == model.damping[joint.idx_v]
        assert robot.coulomb[i] == model.friction[joint.idx_v]
        assert robot.limits.torque[i] == model.effortLimit[joint.idx_v]
        assert robot.limits.velocity[i] == model.velocityLimit[joint.idx_v]
        if joint.nq == 1:
            assert robot.limits.lower[i] == model.lowerPositionLimit[joint.idx_q]
            assert robot.limits.upper[i] == model.upperPositionLimit[joint.idx_q]
        else:
            assert np.isneginf(robot.limits.lower[i]) and np.isposinf(robot.limits.upper[i])
