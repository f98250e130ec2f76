"""The two examples, compared with the spec's recomputation by two independent codes."""

from functools import cache

import numpy as np
import pytest

from slidax.core import runge_kutta_4, semi_implicit_euler
from slidax.simulation import BANDS, simulate
from tests.paper_examples import (
    DISTURBANCE_4_2,
    MOTION_4_1,
    MOTION_4_2,
    START_4_1,
    START_4_2,
    law_4_1,
    law_4_2,
    plant_4_1,
    plant_4_2,
)


@cache
def run(mode="continuous", integrator=runge_kutta_4):
    loop = plant_4_1(), law_4_1(), MOTION_4_1, START_4_1
    return simulate(*loop, t1=10.0, period=1e-4, mode=mode, integrator=integrator, log_every=None)


def last_above(run, band):
    return np.asarray(run.tally.last_above)[BANDS.index(band)] * 1e-4


def test_example_4_1_in_continuous_mode_matches_the_recomputed_metrics():
    tally = run().tally
    assert run().outcome.ok
    assert (int(tally.violations), int(tally.samples)) == (0, 100_001)
    assert np.all(np.asarray(tally.margin) > 0)
    assert last_above(run(), 1e-2) == pytest.approx([0.860, 0.761], abs=0.002)
    assert last_above(run(), 1e-3) == pytest.approx([1.000, 0.891], abs=0.002)
    np.testing.assert_allclose(tally.steady_error, [2.425e-7, 4.363e-7], rtol=0.02)
    np.testing.assert_allclose(tally.peak_torque, [103.653, 97.039], rtol=5e-4)
    np.testing.assert_allclose(tally.first_torque, [103.653, -97.039], rtol=5e-4)
    np.testing.assert_allclose(tally.late_error, [0.2185, 0.4156], rtol=0.01)
    np.testing.assert_allclose(tally.torque_square, [1.0111e7, 1.3003e7], rtol=0.01)
    np.testing.assert_allclose(tally.torque_travel, [1543.1, 1552.5], rtol=0.01)


@pytest.mark.parametrize("integrator", [runge_kutta_4, semi_implicit_euler])
def test_example_4_1_with_a_held_torque_matches_the_recomputed_metrics(integrator):
    held = run("held", integrator)
    assert held.outcome.ok
    assert int(held.tally.violations) == 0
    np.testing.assert_allclose(held.tally.torque_travel, [1549.5, 1560.7], rtol=0.02)
    np.testing.assert_allclose(held.tally.steady_error, [2.425e-7, 4.363e-7], rtol=0.02)
    assert last_above(held, 1e-3) == pytest.approx([1.000, 0.891], abs=0.002)
    np.testing.assert_allclose(held.tally.peak_torque, [103.653, 97.039], rtol=5e-4)


@cache
def run_4_2(factor):
    loop = plant_4_2(factor * DISTURBANCE_4_2), law_4_2(), MOTION_4_2, START_4_2
    done = simulate(*loop, t1=20.0, period=1e-4, mode="continuous", log_every=None)
    assert done.outcome.ok
    assert (int(done.tally.violations), int(done.tally.samples)) == (0, 200_001)
    return done


def test_example_4_2_without_its_disturbance_has_the_papers_accuracy_and_settling_times():
    np.testing.assert_allclose(run_4_2(0.0).tally.steady_error, [4.56e-11, 5.75e-11, 2.08e-12], rtol=0.03)
    settled = last_above(run_4_2(0.0), 1e-8)
    assert settled == pytest.approx([1.3756, 1.3327, 1.5233], abs=0.002)
    assert settled == pytest.approx([1.37, 1.35, 1.53], abs=0.02)


def test_example_4_2_with_its_disturbance_has_an_error_ten_thousand_times_larger():
    np.testing.assert_allclose(run_4_2(1.0).tally.steady_error, [5.04e-7, 6.58e-7, 7.80e-7], rtol=0.01)
    np.testing.assert_allclose(run_4_2(1.0).tally.peak_torque, [9.54, 8.65, 14.43], rtol=0.01)
