"""Loops of joints that move each other: stable only if the coupled loop is."""

from dataclasses import replace

import numpy as np
import pytest

from slidax.certify import certify
from slidax.certify.arm import inertia_ratio
from slidax.scenarios import load
from tests.soundness.linear_arm import demand, scenario

# Each joint by itself is as with the exact inertia: κ is 1.
NEAR = np.array([[1.0, 0.1], [0.1, 1.0]])
# An eigenvalue is -1: along its eigenvector the torque acts in the wrong direction.
FAR = np.array([[1.0, 2.0], [2.0, 1.0]])


@pytest.fixture(scope="module")
def case():
    return scenario(np.random.default_rng(0), delay=1, kalman=False, resolution=0.0, samples=20)


@pytest.fixture(scope="module")
def coupled(case):
    """A demand whose joints are stable by themselves."""
    return replace(demand(case), coupling=0.1 * (1.0 - np.eye(2)))


def test_stability_of_coupled_loops_is_left_open_without_their_matrices(case, coupled):
    verdict = inertia_ratio(case, coupled)
    assert verdict.holds is None and verdict.grade is None and np.max(verdict.bound["radius"]) < 1.0
    assert "the coupled loop was not computed" in verdict.statement and "radius_together" not in verdict.bound
    # Without coupling the loops of single joints are all there is.
    assert inertia_ratio(case, demand(case)).holds is True


def test_coupled_loops_hold_if_they_are_stable_for_each_matrix(case, coupled):
    verdict = inertia_ratio(case, replace(coupled, matrices=np.stack([NEAR, np.eye(2)])))
    assert verdict.holds is True
    assert np.max(verdict.bound["radius"]) <= verdict.bound["radius_together"] + 1e-9 < 1.0


def test_coupled_loops_are_refused_if_one_matrix_makes_them_grow(case, coupled):
    verdict = inertia_ratio(case, replace(coupled, matrices=np.stack([NEAR, FAR])))
    assert verdict.holds is False and np.max(verdict.bound["radius"]) < 1.0 < verdict.bound["radius_together"]
    assert verdict.margin is not None and verdict.margin < 0.0


def test_inertia_ratio_does_not_apply_to_drives_with_a_lag():
    # This run leaves its envelope, and the loops without the lag are stable.
    scenario = load("example-4.2-1khz", {"actuator.time_constant": 0.01})
    verdict = certify(scenario, runs=0)["inertia_ratio"]
    assert verdict.holds is None and "`actuator.time_constant: 0`" in verdict.statement


def test_inertia_ratio_assumes_regular_samples_of_a_sensor_that_loses_some():
    scenario = load("example-4.1-1khz", {"sensor.loss.probability": 0.1, "sensor.jitter": 0.5})
    lines = certify(scenario, runs=0)["inertia_ratio"].assumptions
    (assumed,) = [line for line in lines if "every sample arrives" in line.text]
    assert assumed.status == "assumed" and "`sensor.loss` and `sensor.jitter`" in assumed.text
