"""The tally counts every sample once, whatever is logged, and each statistic agrees with its definition."""

import sys
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.simulation import BANDS, Tally, simulate
from slidax.simulation.tally import Windows
from tests.enrolled import assert_same
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

PERIOD, END = 2e-3, 3.0
SAMPLES = 1501


@cache
def run(log_every, mode="held"):
    law = law_4_1(layer=0.5)
    return simulate(plant_4_1(), law, MOTION_4_1, START_4_1, t1=END, period=PERIOD, mode=mode, log_every=log_every)


@pytest.mark.parametrize("log_every", [None, 7, 100])
def test_the_tally_and_a_thinned_log_agree_with_those_of_a_fully_logged_run(log_every):
    thin, whole = run(log_every), run(1)
    assert_same((thin.tally, thin.state), (whole.tally, whole.state))
    assert_same(thin.log, log_every and jax.tree.map(lambda x: x[::log_every], whole.log))


def test_a_run_of_n_periods_has_n_plus_1_samples():
    log = run(1).log
    assert int(run(1).tally.samples) == SAMPLES
    assert len(log.t) == len(log.k) == len(log.tau) == SAMPLES
    np.testing.assert_array_equal(log.k, np.arange(SAMPLES))
    np.testing.assert_allclose(log.t, np.arange(SAMPLES) * PERIOD, rtol=1e-15)
    assert np.all(log.valid)
    assert log.t[-1] == pytest.approx(END)


@pytest.mark.parametrize("mode", ["held", "continuous"])
def test_tally_statistics_match_their_definitions_on_the_full_log(mode):
    done = run(1, mode)
    assert done.outcome.ok
    log, tally = done.log, done.tally
    e, tau, t = np.asarray(log.e), np.asarray(log.tau), np.asarray(log.t)
    steps = np.abs(np.diff(tau, axis=0))
    last_quarter = t >= 0.75 * END - 1e-9
    width = np.asarray(log.envelope.upper - log.envelope.lower)
    nearer = np.minimum(e - log.envelope.lower, log.envelope.upper - e)
    expected = {
        "early_error": np.abs(e[t <= 2.0 + 1e-9]).sum(axis=0),
        "late_error": np.abs(e[t > 2.0 + 1e-9]).sum(axis=0),
        "error_square": (e**2).sum(axis=0),
        "first_error": np.abs(e[0]),
        "last_error": np.abs(e[-1]),
        "torque_square": (tau**2).sum(axis=0),
        "torque_travel": steps.sum(axis=0),
        "steady_error": np.abs(e[last_quarter]).max(axis=0),
        "first_torque": tau[0],
        "last_torque": tau[-1],
        "peak_torque": np.abs(tau).max(axis=0),
        "max_step": steps.max(axis=0),
        "steady_step": steps[last_quarter[:-1]].max(axis=0),
        "steady_square": (steps[last_quarter[:-1]] ** 2).sum(axis=0),
        "margin": (nearer / width).min(axis=0),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(tally, name), value, rtol=1e-12, err_msg=name)
    for band, last in zip(BANDS, np.asarray(tally.last_above), strict=True):
        for joint in range(2):
            above = np.flatnonzero(np.abs(e[:, joint]) > band)
            assert last[joint] == (above[-1] if len(above) else -1)
    assert int(tally.violations) == 0


def test_the_first_logged_state_is_the_start_and_the_last_is_the_final_state():
    state = run(1).log.state
    for logged, expected in ((state.q[0], START_4_1.q), (state.dq[0], START_4_1.dq)):
        np.testing.assert_array_equal(logged, expected)
    assert_same((state.q[-1], state.dq[-1]), (run(1).state.q, run(1).state.dq))


def test_the_log_has_inputs_and_outputs_of_the_controller():
    log = run(1).log
    k = 700
    reference = MOTION_4_1.reference(jnp.asarray(log.t[k]))
    np.testing.assert_allclose(log.reference.q[k], reference.q, rtol=1e-13)
    np.testing.assert_allclose(log.de[k], log.state.dq[k] - log.reference.dq[k], rtol=0, atol=0)
    assert set(log.signals) == {"s", "eps1", "eps2", "u"}
    assert log.signals["u"].shape == (SAMPLES,)
    assert log.signals["s"].shape == (SAMPLES, 2)


@pytest.mark.parametrize(
    ("engine", "log_every"),
    [("native", 1), ("native", 7), *(pytest.param("xla", n, marks=pytest.mark.full) for n in (1, 7))],
)
def test_the_tally_and_log_do_not_depend_on_the_engines_chunk_size(monkeypatch, log_every, engine):
    def run(log_every):
        loop = plant_4_1(), law_4_1(layer=0.5), MOTION_4_1, START_4_1
        return simulate(*loop, t1=END, period=PERIOD, log_every=log_every, engine=engine)

    logged, whole = run(log_every), run(1)
    monkeypatch.setattr(sys.modules[f"slidax.simulation.{engine}_engine"], "CHUNK", 400)
    chunked = run(log_every)
    assert_same((chunked.tally, chunked.log, chunked.state), (whole.tally, logged.log, whole.state))


def test_the_law_gets_its_memory_back_and_the_reference_one_period_ahead():
    done = simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01)
    np.testing.assert_array_equal(done.log.signals["count"], np.arange(51.0))
    moved = np.diff(done.log.reference.q, axis=0)
    np.testing.assert_allclose(done.log.signals["ahead"][:-1], moved, atol=1e-14)


def test_a_run_without_an_envelope_logs_none_and_has_an_infinite_margin():
    done = simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01, bands=(0.3, 1e-9))
    assert done.outcome.ok and not done.has_envelope and done.log.envelope is None
    assert np.all(np.isinf(done.tally.margin)) and run(1).has_envelope
    # The run has other bands than the default.
    e = np.abs(np.asarray(done.log.e))
    assert np.asarray(done.tally.last_above)[0].tolist() == [np.flatnonzero(e[:, j] > 0.3)[-1] for j in (0, 1)]


def test_a_run_reports_joint_units_period_end_time_and_seconds_of_compiling_and_running():
    done = run(1)
    assert (done.joint_units, done.joints, float(done.period), float(done.t1)) == (("rad", "rad"), 2, PERIOD, END)
    assert done.timing.compile_s > 0 and done.timing.run_s > 0


def test_steady_metrics_exclude_the_torque_step_into_the_last_quarter():
    windows = Windows(steady=jnp.asarray(2), late=jnp.asarray(0), bands=jnp.array([0.1]))
    tally = Tally.empty(1, 1)
    for k, tau in enumerate([0.0, 1.0, 9.0, 9.5, 9.0]):
        tally = tally.add(jnp.asarray(k), jnp.array([0.01 * k]), jnp.array([tau]), None, windows)
    expected = {"steady_step": 0.5, "steady_square": 0.5, "max_step": 8.0, "torque_travel": 10.0, "steady_error": 0.04}
    assert {name: float(getattr(tally, name)[0]) for name in expected} == expected


@pytest.mark.parametrize("log_every", [None, 30_000])
def test_the_tally_of_stiff_example_4_1_is_bit_identical_for_any_log_interval(log_every):
    """A loop of a single iteration is compiled differently and once rounded differently in this example."""

    def tally(log_every):
        return simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=2.0, period=1e-4, log_every=log_every).tally

    assert_same(tally(log_every), tally(7))
