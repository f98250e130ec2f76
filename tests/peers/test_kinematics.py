"""Tools of arms that others described, by Pinocchio; and postures that others find."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms
from slidax.arms import Pose, inverse
from slidax.arms.chain import kinematic_chain
from slidax.motions import Line, follow
from tests.arms.kinematics.postures import drawn, home
from tests.peers.arms import ARMS
from tests.peers.by_pinocchio import held, pinocchio
from tests.peers.ready_arms import for_pinocchio


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_the_tool_is_where_pinocchio_has_it_and_is_found_again(arm):
    ours = arm.read()
    whole = pinocchio.buildModelFromUrdf(arm.path)
    model = held(whole, arm.locked)
    data, body = model.createData(), model.getFrameId(arm.tip, pinocchio.BODY)
    for q in drawn(ours, 5, 4):
        place = pinocchio.neutral(model)
        for name, position in zip(ours.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            place[joint.idx_q : joint.idx_q + joint.nq] = (
                position if joint.nq == 1 else [np.cos(position), np.sin(position)]
            )
        pinocchio.framesForwardKinematics(model, data, place)
        rotation, tip = kinematic_chain(ours).frame(q)
        np.testing.assert_allclose(tip, data.oMf[body].translation, atol=1e-10)
        np.testing.assert_allclose(rotation, data.oMf[body].rotation, atol=1e-10)
        wanted = Pose(tip, rotation)
        found = Pose.of_tip(ours, inverse(ours, wanted, start=np.clip(q + 0.05, *_ends(ours))).q)
        np.testing.assert_allclose(found.place, wanted.place, atol=1e-9)
        np.testing.assert_allclose(found.rotation, wanted.rotation, atol=1e-9)


@pytest.mark.parametrize("name", ["ur5e", "panda", "gen3"])
def test_along_a_path_pinocchio_has_the_tool_on_it(name):
    arm, model = getattr(arms, name)(), for_pinocchio(name)
    start = home(name)
    pose = Pose.of_tip(arm, start)
    found = follow(arm, [Line(by=[0.05, 0.05, 0.0], duration=1.0)], start=start)
    data, body = model.createData(), model.nframes - 1
    for t in np.linspace(0, 1, 21):
        q = np.asarray(found.trajectory.position(jnp.asarray(t)))
        place = []
        for joint, position in zip(list(model.joints)[1:], q, strict=True):
            place += [position] if joint.nq == 1 else [np.cos(position), np.sin(position)]
        pinocchio.framesForwardKinematics(model, data, np.array(place))
        s = 10 * t**3 - 15 * t**4 + 6 * t**5
        np.testing.assert_allclose(data.oMf[body].translation, pose.place + s * np.array([0.05, 0.05, 0]), atol=2e-6)
        np.testing.assert_allclose(data.oMf[body].rotation, pose.rotation, atol=2e-6)


def test_pink_ends_at_the_same_posture_of_an_arm_that_is_not_redundant():
    """pink steps along velocities by quadratic programs; of six joints near one posture there is one answer."""
    pink = pytest.importorskip("pink", reason="pip install pin-pink daqp")
    pytest.importorskip("daqp")
    arm, model = arms.ur5e(), for_pinocchio("ur5e")
    start = home("ur5e")
    pose = Pose.of_tip(arm, start + 0.1)
    ours = inverse(arm, pose, start=start)
    configuration = pink.Configuration(model, model.createData(), start)
    task = pink.FrameTask(model.frames[model.nframes - 1].name, position_cost=1.0, orientation_cost=1.0)
    task.set_target(pinocchio.SE3(pose.rotation, pose.place))
    for _ in range(200):
        velocity = pink.solve_ik(configuration, [task], 0.1, solver="daqp", safety_break=False)
        configuration.integrate_inplace(velocity, 0.1)
    np.testing.assert_allclose(configuration.q, ours.q, atol=1e-5)
    np.testing.assert_allclose(ours.q, start + 0.1, atol=1e-9)


def test_mink_ends_at_the_same_posture_of_an_arm_that_is_not_redundant():
    mink = pytest.importorskip("mink", reason="pip install mink daqp")
    pytest.importorskip("daqp")
    from tests.peers.ready_arms import DESCRIPTIONS, for_mujoco

    arm, model = arms.ur5e(), for_mujoco("ur5e")
    start = home("ur5e")
    pose = Pose.of_tip(arm, start + 0.1)
    ours = inverse(arm, pose, start=start)
    configuration = mink.Configuration(model, q=start)
    task = mink.FrameTask(DESCRIPTIONS["ur5e"]["tip"]["name"], "body", position_cost=1.0, orientation_cost=1.0)
    task.set_target(mink.SE3.from_rotation_and_translation(mink.SO3(pose.quaternion), pose.place))
    for _ in range(200):
        velocity = mink.solve_ik(configuration, [task], 0.1, solver="daqp")
        configuration.integrate_inplace(velocity, 0.1)
    np.testing.assert_allclose(configuration.q, ours.q, atol=1e-5)


def _ends(arm):
    return np.asarray(arm.limits.lower) + 1e-6, np.asarray(arm.limits.upper) - 1e-6
