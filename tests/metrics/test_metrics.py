"""Metrics against their definitions, computed again from a log of every sample."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from slidax import metrics, scenarios
from slidax._errors import DefinitionError
from slidax.simulation import Run


@cache
def whole() -> Run:
    return scenarios.load("example-4.1", {"simulation.period": 4e-4, "simulation.t1": 4.0}).simulate(log_every=1)


def test_settling_time_is_the_last_sample_time_above_the_band() -> None:
    run = whole()
    for band in (1e-2, 1e-3, 1e-4):
        above = np.abs(run.log.e) > band
        expected = [run.log.t[np.flatnonzero(above[:, joint])[-1]] for joint in range(2)]
        np.testing.assert_allclose(metrics.settling_time(run, band), expected, atol=1e-12)


def test_settling_time_is_zero_if_the_error_is_never_above_the_band() -> None:
    scenario = scenarios.load("example-4.1", {"simulation.t1": 0.01})
    from slidax import simulate

    run = simulate(
        scenario.plant,
        scenario.controller,
        scenario.trajectory,
        scenario.state0,
        t1=0.01,
        period=1e-4,
        bands=(100.0,),
    )
    np.testing.assert_array_equal(metrics.settling_time(run, 100.0), [0.0, 0.0])


def test_a_band_that_was_not_tallied_is_refused_with_those_that_were() -> None:
    with pytest.raises(DefinitionError, match=r"the band 0.003 was not tallied; there are 0.01, 0.001.*bands=\(0.003"):
        metrics.settling_time(whole(), 3e-3)


def test_sums_and_peaks_are_those_of_all_samples() -> None:
    run = whole()
    e, tau, t = np.abs(run.log.e), np.asarray(run.log.tau), np.asarray(run.log.t)
    steps = np.abs(np.diff(tau, axis=0))
    late = t >= 3.0 - 1e-9
    expected = {
        "steady_error": e[late].max(0),
        "peak_torque": np.abs(tau).max(0),
        "initial_torque": np.abs(tau[0]),
        "max_torque_step": steps.max(0),
        "steady_torque_step": np.abs(np.diff(tau[late], axis=0)).max(0),
        "steady_torque_step_rms": np.sqrt((np.diff(tau[late], axis=0) ** 2).mean(0)),
        "iae": e[t > 2.0 + 1e-9].sum(0),
        "eci": (tau**2).sum(0),
        "aice": steps.sum(0),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(metrics, name)(run), value, rtol=1e-10, err_msg=name)


def test_the_envelope_margin_is_the_nearest_approach_over_the_width() -> None:
    run = whole()
    lower, upper = np.asarray(run.log.envelope.lower), np.asarray(run.log.envelope.upper)
    nearer = np.minimum(run.log.e - lower, upper - run.log.e) / (upper - lower)
    np.testing.assert_allclose(metrics.envelope_margin(run), nearer.min(0), rtol=1e-12)
    assert metrics.envelope_violations(run) == 0


def test_a_run_that_ends_early_has_no_steady_values_but_keeps_the_others() -> None:
    run = scenarios.load("example-4.1", {"simulation.period": 1e-3}).simulate(log_every=None)
    assert run.outcome.kind == "left_envelope"
    assert metrics.steady_error(run) is None and metrics.steady_torque_step(run) is None
    assert metrics.steady_torque_step_rms(run) is None
    assert np.isfinite(metrics.peak_torque(run)).all()
    text = json.dumps(metrics.summary(run), allow_nan=False)
    assert '"steady_error": null' in text


def test_of_a_run_that_goes_on_outside_all_samples_count_and_the_margin_is_negative() -> None:
    changes = {"start.q": [-0.8, 2.9], "simulation.t1": 1.0}
    run = scenarios.load("example-4.1-1khz", changes).simulate(log_every=1)
    assert run.outcome.kind == "recovered"
    lower, upper = np.asarray(run.log.envelope.lower), np.asarray(run.log.envelope.upper)
    nearer = np.minimum(run.log.e - lower, upper - run.log.e)
    assert metrics.envelope_violations(run) == np.sum((nearer <= 0).any(axis=1)) > 100
    np.testing.assert_allclose(metrics.envelope_margin(run), (nearer / (upper - lower)).min(0), rtol=1e-12)
    assert np.all(metrics.envelope_margin(run) < 0)


def test_the_summary_is_plain_json_with_short_band_names() -> None:
    summary = metrics.summary(whole())
    assert list(summary["settling_time"]) == ["1e-2", "1e-3", "1e-4", "1e-5", "1e-8"]
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
