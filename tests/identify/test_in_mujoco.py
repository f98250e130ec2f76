"""The identification of an arm that MuJoCo moves, with dry friction, encoders and noise."""

import numpy as np
import pytest

import slidax as sx
from slidax.identify import JointLog, identify


@pytest.mark.full
def test_a_log_of_20_s_shows_rotors_friction_and_payload():
    pytest.importorskip("mujoco")
    changes = {
        "robot.plant.mass_factor": 1.0,
        "simulation.plant": "mujoco",
        "simulation.friction": "dry",
        "simulation.t1": 20.0,
    }
    log = sx.scenarios.load("panda-payload", changes).simulate(log_every=1, progress=False).log
    tau = np.asarray(log.tau)
    noise = 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * np.random.default_rng(0).normal(size=tau.shape)
    q = 1e-5 * np.round(np.asarray(log.state.q) / 1e-5)
    arm = sx.arms.panda()
    found = identify(JointLog("a run", arm.joint_names, np.asarray(log.t), q, tau + noise), arm)
    np.testing.assert_allclose(found.values("armature"), 0.1, rtol=0.05)
    np.testing.assert_allclose(found.values("coulomb"), 0.3, rtol=0.05)
    assert found.values("payload.mass")[0] == pytest.approx(2.0, rel=0.02)
    center = [found.values(f"payload.center.{axis}")[0] for axis in "xyz"]
    np.testing.assert_allclose(center, [0.0, 0.0, 0.1], atol=5e-3)
    # Torques that are held for a period come half of it before what they do.
    assert found.lag == pytest.approx(-0.45e-3, abs=5 * found.lag_error + 5e-5)
