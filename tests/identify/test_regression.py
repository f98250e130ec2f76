"""The regressor is the dynamics of the arm, and regression gives parameters of physical bodies."""

import equinox as eqx
import numpy as np
import pytest

import slidax as sx
from slidax.core import as_array
from slidax.identify.regression import consistent_parameters, pseudo_inertia
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
def test_regressor_times_parameters_is_the_arms_torque(arm):
    arm = eqx.tree_at(lambda robot: robot.payload, arm, PAYLOAD)
    motion = JointMotion(*np.random.default_rng(1).normal(size=(3, 4, arm.joints)))
    links, load = parameters_of_links(arm), parameters_of_payload(PAYLOAD)
    torque = links_regressor(arm, motion) @ links + payload_regressor(arm, motion) @ load
    bare = np.diag(np.asarray(arm.armature))
    for row, (q, dq, ddq) in enumerate(zip(*motion, strict=True)):
        own = (np.asarray(arm.mass(as_array(q))) - bare) @ ddq + np.asarray(arm.bias(as_array(q), as_array(dq)))
        np.testing.assert_allclose(torque[row], own, rtol=1e-9, atol=1e-10 * (1.0 + np.abs(own).max()))
    np.testing.assert_allclose(rigid_torque(arm, motion, links, load), torque, rtol=1e-9, atol=1e-9)


def test_a_body_is_recovered_from_its_parameters():
    phi = parameters_of_payload(PAYLOAD)
    mass, center, inertia = body_of_parameters(phi)
    np.testing.assert_allclose(parameters_of_body(mass, center, inertia), phi, rtol=1e-12)
    assert mass == pytest.approx(float(PAYLOAD.mass))
    np.testing.assert_allclose(inertia, PAYLOAD.inertia, atol=1e-12)


GOOD = parameters_of_body(1.0, np.array([0.1, 0.0, 0.05]), np.diag([2e-3, 3e-3, 4e-3]))
INSIDE = np.array([1.0, 0, 0, 0, 0.1, 0.1, 0.1, 0, 0, 0])
NONE = np.zeros(10, bool)


def information(seed):
    half = np.random.default_rng(seed).normal(size=(10, 10))
    return half @ half.T * 100.0 + np.eye(10)


def test_physically_consistent_parameters_stay_bit_for_bit():
    np.testing.assert_array_equal(consistent_parameters(GOOD, information(0), (0,), NONE, INSIDE), GOOD)


@pytest.mark.parametrize("seed", range(4))
def test_inconsistent_parameters_become_the_best_fitting_consistent_parameters(seed):
    weigh, bad = information(seed), GOOD.copy()
    bad[4] = -0.05
    nearest = consistent_parameters(bad, weigh, (0,), NONE, INSIDE)
    least = np.linalg.eigvalsh(pseudo_inertia(nearest))
    assert least[0] > 0 and least[0] < 1e-3
    # Every consistent body is a sum of point masses, so the fit is the best one if no point mass improves it, and
    # neither more nor less of the body itself.
    slope = weigh @ (nearest - bad)
    assert abs(slope @ nearest) < 1e-5
    rng = np.random.default_rng(seed)
    for size in np.repeat([1e-2, 1e-1, 1.0, 10.0], 200):
        point = parameters_of_body(1.0, size * rng.normal(size=3), np.zeros((3, 3)))
        assert slope @ point > -1e-6 * np.linalg.norm(point)


def test_negative_estimates_become_zero_and_the_others_are_refitted():
    weigh = np.array([[2.0, 1.0], [1.0, 2.0]]) * 1e4
    nearest = consistent_parameters(np.array([-1.0, 3.0]), weigh, (), np.array([True, False]), np.array([1.0, 1.0]))
    assert 0 < nearest[0] < 1e-3
    # With the first on its bound, the best of the second is where its slope is 0: 3 - 1/2.
    assert nearest[1] == pytest.approx(2.5, abs=1e-3)
