"""Arms from URDF files, by slidax and by Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

from tests.peers.arms import ARMS, Arm, cases
from tests.peers.motion import Motion, States, assert_same, by_slidax, random_states

pinocchio = pytest.importorskip("pinocchio")


def model_of(arm: Arm):
    model = pinocchio.buildModelFromUrdf(arm.path)
    if not arm.locked:
        return model
    still = pinocchio.neutral(model)
    for name, position in arm.locked.items():
        still[model.joints[model.getJointId(name)].idx_q] = position
    return pinocchio.buildReducedModel(model, [model.getJointId(name) for name in arm.locked], still)


def by_pinocchio(arm: Arm, joint_names: tuple[str, ...], states: States) -> Motion:
    model = model_of(arm)
    model.damping = np.zeros(model.nv)
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in joint_names]
    at = [joint.idx_v for joint in joints]
    assert sorted(at) == list(range(model.nv))
    tip = model.getFrameId(arm.tip, pinocchio.BODY)
    found = []
    for q, dq, tau in zip(*states, strict=True):
        place, velocity, torque = pinocchio.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for joint, position in zip(joints, q, strict=True):
            # Of a joint without end Pinocchio has the cosine and the sine.
            place[joint.idx_q : joint.idx_q + joint.nq] = (
                position if joint.nq == 1 else [np.cos(position), np.sin(position)]
            )
        velocity[at], torque[at] = dq, tau
        bias = np.array(pinocchio.nle(model, data, place, velocity))
        gravity = np.array(pinocchio.computeGeneralizedGravity(model, data, place))
        acceleration = np.array(pinocchio.aba(model, data, place, velocity, torque))
        mass = np.array(pinocchio.crba(model, data, place))
        pinocchio.framesForwardKinematics(model, data, place)
        frame = data.oMf[tip]
        found.append(
            (
                mass[np.ix_(at, at)],
                bias[at],
                gravity[at],
                acceleration[at],
                frame.translation.copy(),
                frame.rotation.copy(),
            )
        )
    return Motion(*(np.stack(part) for part in zip(*found, strict=True)))


@pytest.mark.parametrize(("arm", "count"), cases())
def test_an_arm_from_urdf_moves_as_pinocchio_says(arm, count):
    robot = arm.read()
    states = random_states(robot, count)
    assert_same(by_slidax(robot, states), by_pinocchio(arm, robot.joint_names, states))


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
