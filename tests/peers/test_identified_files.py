"""Excitation and identification of arms from third-party URDF files."""

import equinox as eqx
import numpy as np
import pytest

from slidax.arms import Payload
from slidax.core import as_array
from slidax.identify import excitation, excite, identify
from tests.identify.recorded import recorded
from tests.peers.arms import ARMS

SOME = [arm for arm in ARMS if arm.name in ("z1.urdf", "kinova.urdf", "xarm7.urdf", "ur10_robot.urdf", "TwoDofs.urdf")]


@pytest.mark.parametrize("file", SOME, ids=lambda file: file.name)
def test_an_arm_from_a_file_is_excited_and_identified(file, monkeypatch):
    monkeypatch.setattr(excitation, "STARTS", 5)
    monkeypatch.setattr(excitation, "STEPS", 30)
    arm = file.read()
    n = arm.joints
    rng = np.random.default_rng(2)
    rated = np.where(np.isfinite(arm.limits.torque), arm.limits.torque, 20.0)
    true = eqx.tree_at(
        lambda robot: (robot.armature, robot.coulomb, robot.viscous, robot.payload),
        arm,
        (
            as_array(2e-3 * rated * rng.uniform(0.5, 2.0, n)),
            as_array(1e-2 * rated),
            as_array(1e-2 * rated),
            Payload(mass=as_array(0.4), center=as_array([0.01, 0.0, 0.05]), inertia=as_array(1e-3)),
        ),
    )
    motion = excite(true, seed=0, duration=10.0, rate=250.0)
    identified = identify(recorded(true, times_and_motion=(motion.t, motion.motion)), arm)
    for name in ("armature", "coulomb", "viscous"):
        off = np.abs(identified.values(name) - np.asarray(getattr(true, name)))
        assert (off < 4.5 * identified.standard_errors(name)).all(), name
        np.testing.assert_allclose(identified.values(name), getattr(true, name), rtol=0.3)
    assert abs(identified.values("payload.mass")[0] - 0.4) < 4.0 * identified.standard_errors("payload.mass")[0]
    assert (identified.held_out_rms < 0.1 * identified.measured_rms).all()
