"""Rival schemes, compared with the spec's recomputation; of chattering runs, only values independent of the solver."""

from functools import cache

import numpy as np
import pytest

from slidax.law import Linear
from slidax.simulation import BANDS, simulate
from tests.paper_examples import DISTURBANCE_4_2, MOTION_4_1, MOTION_4_2, START_4_1, START_4_2, plant_4_1, plant_4_2
from tests.rivals import (
    AROUND_4_1,
    AROUND_4_2,
    anftsmc_4_2,
    ftsmc_4_1,
    ftsmppc_4_1,
    nftsmc_4_2,
    sfsmc_4_2,
    slotine_li_4_1,
    super_twisting_4_2,
)


@cache
def example_4_1(law, log_every=None, **gains):
    extra = {"t1": 10.0, "period": 1e-4, "mode": "continuous", "log_every": log_every}
    return simulate(plant_4_1(), law(**gains), MOTION_4_1, START_4_1, **extra)


def example_4_2(controller, factor=1.0, t1=10.0, **extra):
    extra = {"t1": t1, "period": 1e-4, "mode": "continuous", "log_every": None} | extra
    return simulate(plant_4_2(factor * DISTURBANCE_4_2), controller, MOTION_4_2, START_4_2, **extra)


def settled(run, band):
    return np.asarray(run.tally.last_above)[BANDS.index(band)] * 1e-4


def test_ftsmc_settling_times_and_initial_torques_match_the_recomputation():
    run = example_4_1(ftsmc_4_1, 1)
    assert run.outcome.ok
    assert settled(run, 1e-3) == pytest.approx([1.027, 0.968], abs=0.003)
    np.testing.assert_allclose(run.tally.peak_torque, [88.21, 66.51], rtol=1e-3)
    np.testing.assert_allclose(np.abs(run.tally.first_torque), [88.21, 66.51], rtol=1e-3)


def test_ftsmc_with_a_boundary_layer_has_the_recomputed_error_and_two_torque_jumps():
    run = example_4_1(ftsmc_4_1, 1, layer=0.05)
    np.testing.assert_allclose(run.tally.steady_error, [1.99e-4, 3.77e-4], rtol=0.01)
    np.testing.assert_allclose(run.tally.torque_travel, [315.0, 368.0], rtol=0.01)
    jumps = np.abs(np.diff(np.asarray(run.log.tau), axis=0)).max(axis=1)
    times = np.asarray(run.log.t)[1:][jumps > 0.5]
    assert times == pytest.approx([0.827, 0.881], abs=1e-3)
    assert np.sort(jumps)[-3] < 0.02 * np.sort(jumps)[-2]


def test_the_chattering_torque_averages_to_that_of_the_smooth_run():
    """The mean torque is the equivalent control, which does not depend on the switching.

    The torque is held: in continuous mode, the log would have only the first of four stages.
    """
    means = []
    for layer in (0.0, 0.05):
        run = simulate(plant_4_1(), ftsmc_4_1(layer=layer), MOTION_4_1, START_4_1, t1=8.0, period=1e-4)
        means.append(np.asarray(run.log.tau)[40_000:].mean(axis=0))
    np.testing.assert_allclose(means[0], means[1], atol=0.02)


def test_ftsmppc_error_and_torque_variation_match_the_recomputation():
    run = example_4_1(ftsmppc_4_1)
    assert run.outcome.ok
    np.testing.assert_allclose(run.tally.torque_travel, [1477.7, 1480.4], rtol=0.01)
    np.testing.assert_allclose(run.tally.steady_error, [4.2e-7, 7.2e-7], rtol=0.02)


def test_sfsmc_has_the_recomputed_initial_torque_and_settles_earlier_than_in_the_paper():
    run = example_4_2(sfsmc_4_2(), t1=4.0)
    np.testing.assert_allclose(np.abs(run.tally.first_torque)[2], 44.4, rtol=0.01)
    # Table 3 has 2.20, 2.12, 2.35 s, to a band that it does not state.
    assert np.all(settled(run, 1e-2) < 2.1)


def test_anftsmc_settling_times_match_the_recomputation_and_its_adaptive_parameters_grow():
    run = example_4_2(anftsmc_4_2(), factor=0.0, t1=5.0, log_every=100)
    assert settled(run, 1e-5) == pytest.approx([1.74, 1.45, 1.74], abs=0.03)
    np.testing.assert_allclose(np.abs(run.tally.first_torque)[2], 215.0, rtol=0.01)
    learnt = np.asarray(run.log.signals["b"])
    np.testing.assert_array_equal(learnt[0], 0.0)
    assert np.all(np.diff(learnt, axis=0) >= 0)
    assert np.all(learnt[-1] > 1e-5)


def test_anftsmc_with_the_disturbance_has_the_recomputed_error():
    run = example_4_2(anftsmc_4_2(), t1=20.0, log_every=10)
    late = np.abs(np.asarray(run.log.e))[np.asarray(run.log.t) > 10.0]
    np.testing.assert_allclose(late.max(axis=0), [0.067, 0.129, 0.0097], rtol=0.01)


def test_nftsmc_with_a_tiny_boundary_layer_has_about_the_papers_settling_times():
    run = example_4_2(nftsmc_4_2(layer=3e-4), t1=20.0)
    np.testing.assert_allclose(run.tally.steady_error, [1.97e-5, 3.10e-5, 8.2e-6], rtol=0.02)
    # Table 3's times, to a band that it does not state.
    assert settled(run, 1e-4) == pytest.approx([1.77, 1.47, 1.75], abs=0.1)


@pytest.mark.parametrize("mode", ["held", "continuous"])
def test_super_twisting_rejects_the_disturbance_with_a_continuous_torque(mode):
    run = example_4_2(super_twisting_4_2(), mode=mode)
    assert np.all(np.asarray(run.tally.steady_error) < 1e-6)
    assert np.all(np.asarray(run.tally.steady_step) < 0.1)


ENVELOPED = [
    pytest.param(sfsmc_4_2(transformation=AROUND_4_2, c1=0.2, c2=0.6, beta=1.2, layer=0.05), 3, id="sfsmc"),
    pytest.param(sfsmc_4_2(transformation=AROUND_4_2, c1=0.2, c2=0.6, beta=1.2), 3, id="sfsmc_unit_vector"),
    pytest.param(slotine_li_4_1(AROUND_4_1, Linear(0.6)), 2, id="slotine_li"),
    pytest.param(super_twisting_4_2(AROUND_4_2, Linear(0.6)), 3, id="super_twisting"),
]


@pytest.mark.parametrize(("controller", "joints"), ENVELOPED)
def test_schemes_on_a_sliding_surface_stay_inside_a_fixed_time_envelope(controller, joints):
    if joints == 3:
        run = example_4_2(controller)
    else:
        extra = {"t1": 10.0, "period": 1e-4, "mode": "continuous", "log_every": None}
        run = simulate(plant_4_1(), controller, MOTION_4_1, START_4_1, **extra)
    assert run.outcome.ok
    assert int(run.tally.violations) == 0
    assert np.all(np.asarray(run.tally.margin) > 0.05)
    assert np.all(np.asarray(run.tally.steady_error) < 2e-3)
