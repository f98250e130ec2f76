"""Example 4.1 as the spec re-computed it with two independent codes, in continuous mode and with a held torque."""

from functools import cache

import numpy as np
import pytest

from slidax.core import semi_implicit_euler
from slidax.simulation import BANDS, simulate
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1


@cache
def continuous():
    return simulate(
        plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=10.0, period=1e-4, mode="continuous", log_every=None
    )


@cache
def held(integrator=None):
    extra = {} if integrator is None else {"integrator": integrator}
    return simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=10.0, period=1e-4, log_every=None, **extra)


def last_above(run, band):
    return np.asarray(run.tally.last_above)[BANDS.index(band)] * 1e-4


def test_the_run_reaches_its_end_inside_the_envelope():
    assert continuous().outcome.ok
    assert int(continuous().tally.violations) == 0
    assert int(continuous().tally.samples) == 100_001
    assert np.all(np.asarray(continuous().tally.margin) > 0)


def test_the_error_settles_when_it_should():
    assert last_above(continuous(), 1e-2) == pytest.approx([0.860, 0.761], abs=0.002)
    assert last_above(continuous(), 1e-3) == pytest.approx([1.000, 0.891], abs=0.002)


def test_the_steady_error_is_that_of_the_spec():
    np.testing.assert_allclose(continuous().tally.steady_error, [2.425e-7, 4.363e-7], rtol=0.02)


def test_the_largest_torque_is_the_first():
    np.testing.assert_allclose(continuous().tally.peak_torque, [103.653, 97.039], rtol=5e-4)
    np.testing.assert_allclose(continuous().tally.first_torque, [103.653, -97.039], rtol=5e-4)


def test_the_three_sums_are_those_of_the_spec():
    np.testing.assert_allclose(continuous().tally.late_error, [0.2185, 0.4156], rtol=0.01)
    np.testing.assert_allclose(continuous().tally.torque_square, [1.0111e7, 1.3003e7], rtol=0.01)
    np.testing.assert_allclose(continuous().tally.torque_travel, [1543.1, 1552.5], rtol=0.01)


@pytest.mark.parametrize("integrator", [None, semi_implicit_euler], ids=["runge_kutta", "semi_implicit_euler"])
def test_with_a_held_torque_nearly_the_same(integrator):
    run = held(integrator)
    assert run.outcome.ok
    assert int(run.tally.violations) == 0
    np.testing.assert_allclose(run.tally.torque_travel, [1549.5, 1560.7], rtol=0.02)
    np.testing.assert_allclose(run.tally.steady_error, [2.425e-7, 4.363e-7], rtol=0.02)
    assert last_above(run, 1e-3) == pytest.approx([1.000, 0.891], abs=0.002)
    np.testing.assert_allclose(run.tally.peak_torque, [103.653, 97.039], rtol=5e-4)
