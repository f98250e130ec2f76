"""Small robot files with what real ones have: turned inertias, an arm on a wall, position drives whose range is rad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slidax.arms import from_mjcf, from_urdf
from slidax.simulation.states import states_of
from tests.peers.by_pinocchio import pinocchio

FILES = Path(__file__).parent / "files"
STATES = np.random.default_rng(4).uniform(-2.0, 2.0, (2, 3, 3))


@pytest.mark.parametrize(("file", "tip"), [("turned.urdf", "surface"), ("wall.urdf", "hand")])
def test_a_urdf_file_moves_as_pinocchio_says(file, tip):
    model = pinocchio.buildModelFromUrdf(str(FILES / file))
    ours = states_of(from_urdf(FILES / file, tip=tip), *STATES)
    for q, dq, mass, bias in zip(*STATES, ours.mass, ours.bias, strict=True):
        data = model.createData()
        upper = np.triu(pinocchio.crba(model, data, q))
        np.testing.assert_allclose(mass, upper + np.triu(upper, 1).T, rtol=0, atol=1e-12)
        np.testing.assert_allclose(bias, pinocchio.nle(model, data, q, dq), rtol=0, atol=1e-11)


def test_a_range_of_positions_is_no_torque_limit_and_the_rest_is_mujocos():
    mujoco = pytest.importorskip("mujoco")
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
