"""Arms from URDF files, by slidax and by MuJoCo's own dynamics."""

from __future__ import annotations

import time

import numpy as np
import pytest

from slidax.robots.files.loader import reading
from tests.peers.arms import ARMS, Arm, cases
from tests.peers.motion import Motion, States, assert_same, by_slidax, random_states

mujoco = pytest.importorskip("mujoco")


def model_of(arm: Arm):
    """As MuJoCo reads it, but without shapes, whose meshes it would need, and without joining what is fixed."""
    with reading():
        spec = mujoco.MjSpec.from_file(arm.path)
        for shape in (*spec.geoms, *spec.meshes):
            spec.delete(shape)
        spec.compiler.fusestatic = False
        model = spec.compile()
    model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model


def by_mujoco(arm: Arm, joint_names: tuple[str, ...], states: States) -> Motion:
    model = model_of(arm)
    data = mujoco.MjData(model)
    at = [int(model.joint(name).dofadr[0]) for name in joint_names]
    full, found = np.zeros((model.nv, model.nv)), []
    for name, position in arm.locked.items():
        data.joint(name).qpos = position
    tip = model.body(arm.tip).id
    for q, dq, tau in zip(*states, strict=True):
        data.qpos[at], data.qvel[at], data.qfrc_applied[at] = q, 0.0, tau
        mujoco.mj_forward(model, data)
        gravity = data.qfrc_bias[at].copy()
        data.qvel[at] = dq
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        mass, bias = full[np.ix_(at, at)], data.qfrc_bias[at].copy()
        # What is locked needs forces of its own, which MuJoCo does not have: so its rows are left out.
        acceleration = np.linalg.solve(mass, tau - bias) if arm.locked else data.qacc[at].copy()
        found.append((mass, bias, gravity, acceleration, data.xpos[tip].copy(), data.xmat[tip].reshape(3, 3).copy()))
    return Motion(*(np.stack(part) for part in zip(*found, strict=True)))


@pytest.mark.parametrize(("arm", "count"), cases())
def test_an_arm_from_urdf_moves_as_mujoco_says(arm, count):
    robot = arm.read()
    states = random_states(robot, count)
    assert_same(by_slidax(robot, states), by_mujoco(arm, robot.joint_names, states))


def test_a_panda_with_its_meshes_is_read_within_a_second():
    start = time.perf_counter()
    ARMS[0].read()
    assert time.perf_counter() - start < 1.0
