"""The regressor is the arm's own dynamics, and Pinocchio's."""

import equinox as eqx
import numpy as np
import pytest

import slidax as sx
from slidax.core import as_array
from slidax.identify.regressor import (
    JointMotion,
    body_of_parameters,
    links_regressor,
    parameters_of_body,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from tests.arms.members import ROBOTS
from tests.identify.recorded import PAYLOAD

ARMS = [
    pytest.param(arm, id=name, marks=[] if name == "small_tree" else [pytest.mark.full])
    for name, arm in ROBOTS
    if isinstance(arm, sx.arms.Articulated)
]


@pytest.mark.parametrize("arm", ARMS)
def test_the_columns_times_the_parameters_are_the_arms_own_torque(arm):
    arm = eqx.tree_at(lambda robot: robot.payload, arm, PAYLOAD)
    motion = JointMotion(*np.random.default_rng(1).normal(size=(3, 4, arm.joints)))
    links, load = parameters_of_links(arm), parameters_of_payload(PAYLOAD)
    torque = links_regressor(arm, motion) @ links + payload_regressor(arm, motion) @ load
    bare = np.diag(np.asarray(arm.armature))
    for row, (q, dq, ddq) in enumerate(zip(*motion, strict=True)):
        own = (np.asarray(arm.mass(as_array(q))) - bare) @ ddq + np.asarray(arm.bias(as_array(q), as_array(dq)))
        np.testing.assert_allclose(torque[row], own, rtol=1e-9, atol=1e-10 * (1.0 + np.abs(own).max()))
    np.testing.assert_allclose(rigid_torque(arm, motion, links, load), torque, rtol=1e-9, atol=1e-9)


def test_a_body_comes_back_from_its_parameters():
    phi = parameters_of_payload(PAYLOAD)
    mass, center, inertia = body_of_parameters(phi)
    np.testing.assert_allclose(parameters_of_body(mass, center, inertia), phi, rtol=1e-12)
    assert mass == pytest.approx(float(PAYLOAD.mass))
    np.testing.assert_allclose(inertia, PAYLOAD.inertia, atol=1e-12)
