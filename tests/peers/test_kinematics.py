"""Tool poses against Pinocchio, and inverse kinematics against pink and mink."""

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
from tests.peers.by_pinocchio import held, pinocchio, position
from tests.peers.ready_arms import DESCRIPTIONS, for_mujoco, for_pinocchio


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_tool_pose_agrees_with_pinocchio_and_inverse_kinematics_recovers_it(arm):
    ours = arm.read()
    whole = pinocchio.buildModelFromUrdf(arm.path)
    model = held(whole, arm.locked)
    data, body = model.createData(), model.getFrameId(arm.tip, pinocchio.BODY)
    for q in drawn(ours, 5, 4):
        pinocchio.framesForwardKinematics(model, data, position(model, ours.joint_names, q))
        rotation, tip = kinematic_chain(ours).frame(q)
        np.testing.assert_allclose(tip, data.oMf[body].translation, atol=1e-10)
        np.testing.assert_allclose(rotation, data.oMf[body].rotation, atol=1e-10)
        wanted = Pose(tip, rotation)
        reached = Pose.of_tip(ours, inverse(ours, wanted, start=np.clip(q + 0.05, *_ends(ours))).q)
        np.testing.assert_allclose(reached.position, wanted.position, atol=1e-9)
        np.testing.assert_allclose(reached.rotation, wanted.rotation, atol=1e-9)


@pytest.mark.parametrize("name", ["ur5e", "panda", "gen3"])
def test_pinocchio_confirms_the_tool_pose_along_a_path(name):
    arm, model = getattr(arms, name)(), for_pinocchio(name)
    start = home(name)
    pose = Pose.of_tip(arm, start)
    followed = follow(arm, [Line(by=[0.05, 0.05, 0.0], duration=1.0)], start=start)
    data, body = model.createData(), model.nframes - 1
    for t in np.linspace(0, 1, 21):
        q = np.asarray(followed.trajectory.position(jnp.asarray(t)))
        pinocchio.framesForwardKinematics(model, data, position(model, arm.joint_names, q))
        s = 10 * t**3 - 15 * t**4 + 6 * t**5
        np.testing.assert_allclose(data.oMf[body].translation, pose.position + s * np.array([0.05, 0.05, 0]), atol=2e-6)
        np.testing.assert_allclose(data.oMf[body].rotation, pose.rotation, atol=2e-6)


@pytest.mark.parametrize("peer", ["pink", "mink"])
def test_pink_and_mink_reach_the_same_posture_of_a_nonredundant_arm(peer):
    """Both integrate velocities from quadratic programs; near a posture, six joints have a unique solution."""
    package = pytest.importorskip(peer, reason="pip install pin-pink mink daqp")
    pytest.importorskip("daqp")
    arm, start, costs = arms.ur5e(), home("ur5e"), {"position_cost": 1.0, "orientation_cost": 1.0}
    pose = Pose.of_tip(arm, start + 0.1)
    ours = inverse(arm, pose, start=start)
    if peer == "pink":
        model = for_pinocchio("ur5e")
        configuration = package.Configuration(model, model.createData(), start)
        task = package.FrameTask(model.frames[model.nframes - 1].name, **costs)
        task.set_target(pinocchio.SE3(pose.rotation, pose.position))
    else:
        configuration = package.Configuration(for_mujoco("ur5e"), q=start)
        task = package.FrameTask(DESCRIPTIONS["ur5e"]["tip"]["name"], "body", **costs)
        task.set_target(package.SE3.from_rotation_and_translation(package.SO3(pose.quaternion), pose.position))
    options = {"solver": "daqp"} | ({"safety_break": False} if peer == "pink" else {})
    for _ in range(200):
        configuration.integrate_inplace(package.solve_ik(configuration, [task], 0.1, **options), 0.1)
    np.testing.assert_allclose(configuration.q, ours.q, atol=1e-5)
    np.testing.assert_allclose(ours.q, start + 0.1, atol=1e-9)


def _ends(arm):
    return np.asarray(arm.limits.lower) + 1e-6, np.asarray(arm.limits.upper) - 1e-6
