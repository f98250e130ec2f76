"""Arms from URDF files, by slidax, by Pinocchio and by MuJoCo's own dynamics."""

from __future__ import annotations

import time
from pathlib import Path

import jax
import numpy as np
import pytest

from slidax.arms import from_mjcf, from_urdf
from slidax.arms.files.reading import reading
from slidax.simulation.states import states_of
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import ANY_LIMIT, END, GOOD, LIMIT, SPARE, joint
from tests.peers.arms import ARMS, WALKER, Arm
from tests.peers.by_mujoco import by_mujoco, mujoco
from tests.peers.by_pinocchio import by_pinocchio, held, pinocchio
from tests.peers.motion import assert_same, by_slidax, random_states

FILES = Path(__file__).parent / "files"
STATES = np.random.default_rng(4).uniform(-2.0, 2.0, (2, 3, 3))


def of_pinocchio(arm: Arm):
    return held(pinocchio.buildModelFromUrdf(arm.path), arm.locked)


def of_mujoco(arm: Arm):
    """MuJoCo's model without shapes, whose meshes it would need, and without fusing fixed links."""
    with reading():
        spec = mujoco.MjSpec.from_file(arm.path)
        for shape in (*spec.geoms, *spec.meshes):
            spec.delete(shape)
        spec.compiler.fusestatic = False
        return spec.compile()


def motion_by_pinocchio(arm: Arm, joint_names, states):
    return by_pinocchio(of_pinocchio(arm), arm.tip, joint_names, states)


def motion_by_mujoco(arm: Arm, joint_names, states):
    return by_mujoco(of_mujoco(arm), arm.tip, joint_names, states, arm.locked)


@pytest.mark.parametrize("peer", [motion_by_pinocchio, motion_by_mujoco])
@pytest.mark.parametrize(
    ("arm", "count"),
    [
        pytest.param(ARMS[0], 100, id=ARMS[0].name),
        *(pytest.param(arm, 1000, id=f"{arm.name}-full", marks=pytest.mark.full) for arm in (*ARMS, WALKER)),
    ],
)
def test_dynamics_of_a_urdf_arm_agree_with_pinocchio_and_mujoco(arm, count, peer):
    robot = arm.read()
    states = random_states(robot, count)
    assert_same(by_slidax(robot, states), peer(arm, robot.joint_names, states))


@pytest.mark.parametrize("arm", [arm for arm in ARMS if arm.limits], ids=lambda arm: arm.name)
def test_friction_and_limits_from_urdf_are_those_that_pinocchio_reads(arm):
    robot, model = arm.read(), of_pinocchio(arm)
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


def test_a_panda_with_its_meshes_is_read_within_a_second():
    start = time.perf_counter()
    ARMS[0].read()
    assert time.perf_counter() - start < 1.0


WRIST = SPARE + joint(
    "revolute", "wrist", "tool", "spare", '<axis xyz="1 2 0"/>' + ANY_LIMIT + '<origin xyz="0.1 0 0.2" rpy="0.3 0 1"/>'
)
SLIDE = SPARE.replace("spare", "rail") + joint(
    "prismatic",
    "slide",
    "spare",
    "rail",
    '<axis xyz="0 1 1"/>' + ANY_LIMIT + '<mimic joint="elbow" multiplier="0.3" offset="-0.1"/>',
)
FOLLOWING = {
    "an elbow that follows the shoulder": changed(
        GOOD, LIMIT, LIMIT + '<mimic joint="shoulder" multiplier="-0.5" offset="0.2"/>', END, WRIST + END
    ),
    "a slide that follows the elbow": changed(GOOD, END, WRIST + SLIDE + END),
}


@pytest.mark.parametrize("text", FOLLOWING.values(), ids=FOLLOWING)
@pytest.mark.filterwarnings("ignore::slidax.DefinitionWarning")
def test_dynamics_of_an_arm_with_mimic_joints_agree_with_pinocchio(text):
    arm = from_urdf(text, limits=False)
    model = pinocchio.buildModelFromXML(text, mimic=True)
    assert tuple(model.names)[1:] == arm.arm.joint_names
    model.damping = np.zeros(model.nv)
    motion = jax.jit(lambda q, dq: (arm.mass(q), arm.bias(q, dq), arm.gravity(q)))
    for q, dq in np.random.default_rng(5).uniform(-2.0, 2.0, (3, 2, arm.joints)):
        # Pinocchio's crba adds to the result of an earlier call in the rows of leaders.
        data = model.createData()
        mass = np.array(pinocchio.crba(model, data, q))
        mass = np.triu(mass) + np.triu(mass, 1).T
        expected = (mass, pinocchio.nle(model, data, q, dq), pinocchio.computeGeneralizedGravity(model, data, q))
        for ours, theirs in zip(motion(q, dq), expected, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * np.linalg.norm(theirs))


@pytest.mark.parametrize(("file", "tip"), [("turned.urdf", "surface"), ("wall.urdf", "hand")])
def test_inertia_and_bias_of_a_urdf_file_agree_with_pinocchio(file, tip):
    model = pinocchio.buildModelFromUrdf(str(FILES / file))
    ours = states_of(from_urdf(FILES / file, tip=tip), *STATES)
    for q, dq, mass, bias in zip(*STATES, ours.mass, ours.bias, strict=True):
        data = model.createData()
        upper = np.triu(pinocchio.crba(model, data, q))
        np.testing.assert_allclose(mass, upper + np.triu(upper, 1).T, rtol=0, atol=1e-12)
        np.testing.assert_allclose(bias, pinocchio.nle(model, data, q, dq), rtol=0, atol=1e-11)


def test_an_mjcf_position_range_is_no_torque_limit_and_dynamics_agree_with_mujoco():
    arm = from_mjcf(FILES / "position.xml", tip="hand")
    assert np.isinf(np.asarray(arm.limits.torque)).all()
    model = mujoco.MjModel.from_xml_path(str(FILES / "position.xml"))
    ours = states_of(arm, *STATES)
    for q, dq, mass, bias in zip(*STATES, ours.mass, ours.bias, strict=True):
        data, full = mujoco.MjData(model), np.zeros((3, 3))
        data.qpos[:], data.qvel[:] = q, dq
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        np.testing.assert_allclose(mass, full, rtol=0, atol=1e-12)
        np.testing.assert_allclose(bias, data.qfrc_bias, rtol=0, atol=1e-11)
