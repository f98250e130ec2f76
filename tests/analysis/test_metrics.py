"""Metrics against their definitions, in frames, batches and derivatives."""

import inspect
import json
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import analysis, scenarios, studies
from slidax.analysis import METRICS, Metric, index_sums
from slidax.analysis.index_sums import INDEX_SUMS
from slidax.analysis.metric import safe_sqrt
from slidax.core.errors import DefinitionError
from slidax.report import Rival, standings
from slidax.simulation import Run, Tally, simulate, simulate_batch, value_and_gradient
from slidax.simulation.run import data_frame
from tests.paper_examples import MOTION_4_1, START_4_1
from tests.simulation.simple import SMOOTH_PLANT, BoundedLaw, Spring


@cache
def whole() -> Run:
    return scenarios.load("example-4.1", {"simulation.period": 4e-4, "simulation.t1": 4.0}).simulate(log_every=1)


def test_settling_time_is_the_last_sample_time_above_the_band():
    run = whole()
    for band in (1e-2, 1e-3, 1e-4):
        above = np.abs(run.log.e) > band
        expected = [run.log.t[np.flatnonzero(above[:, joint])[-1]] for joint in range(2)]
        np.testing.assert_allclose(analysis.settling_time(run, band), expected, atol=1e-12)


def test_settling_time_is_zero_if_the_error_is_never_above_the_band():
    scenario = scenarios.load("example-4.1", {"simulation.t1": 0.01})
    run = simulate(
        scenario.plant, scenario.controller, scenario.trajectory, scenario.state0, t1=0.01, period=1e-4, bands=(100.0,)
    )
    np.testing.assert_array_equal(analysis.settling_time(run, 100.0), [0.0, 0.0])


def test_unknown_settling_band_is_refused_with_the_available_bands():
    with pytest.raises(DefinitionError, match=r"the run has no settling band 0.003, only 0.01, 0.001.*bands=\(0.003"):
        analysis.settling_time(whole(), 3e-3)


def test_error_and_torque_metrics_agree_with_their_definitions_over_all_samples():
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
        "rms_error": np.sqrt(np.trapezoid(e**2, t, axis=0) / 4.0),
        "iae": np.trapezoid(e, t, axis=0),
        "torque_energy": np.trapezoid(tau**2, t, axis=0),
        "torque_travel": steps.sum(0),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(analysis, name)(run), value, rtol=1e-10, err_msg=name)
    printed = {"iae": e[t > 2.0 + 1e-9].sum(0), "eci": (tau**2).sum(0), "aice": steps.sum(0)}
    for name, value in printed.items():
        np.testing.assert_allclose(getattr(index_sums, name)(run), value, rtol=1e-10, err_msg=name)


def test_halving_the_period_keeps_the_integrals_but_doubles_the_papers_sums():
    changes = {"simulation.period": 2e-4, "simulation.t1": 4.0}
    whole_period, half = whole(), scenarios.load("example-4.1", changes).simulate(log_every=None)
    for metric in (analysis.iae, analysis.rms_error, analysis.torque_energy, analysis.torque_travel):
        np.testing.assert_allclose(metric(half), metric(whole_period), rtol=2e-3, err_msg=metric.key)
    for index in (index_sums.iae, index_sums.eci):
        np.testing.assert_allclose(index(half), 2.0 * index(whole_period), rtol=0.01, err_msg=index.key)


@pytest.mark.full
@pytest.mark.parametrize("engine", ["native", "xla"])
def test_each_run_of_a_batch_has_the_metrics_of_the_single_run(engine):
    """One run leaves its envelope before its last quarter, one after its first sample; one is good."""
    scenario = scenarios.load("example-4.1", {"simulation.period": 1e-3, "simulation.mode": "held"})
    deadlines = jnp.array([5.0, 0.05, 0.004])

    def parts(deadline: Any) -> Any:
        law = eqx.tree_at(lambda c: c.transformation.performance.deadline, scenario.controller, deadline)
        return scenario.plant, law, scenario.trajectory, scenario.state0

    how: dict[str, Any] = {"t1": 1.0, "period": 1e-3, "log_every": None, "engine": engine}
    many = simulate_batch(parts, deadlines, **how)
    singles = [simulate(*parts(deadline), **how) for deadline in deadlines]
    summary = analysis.summary(many, INDEX_SUMS)
    assert [run.outcome.ok for run in singles] == [True, False, False]
    for i, run in enumerate(singles):
        alone = analysis.summary(run, INDEX_SUMS)
        for metric in (*analysis.metrics_of(run), *INDEX_SUMS):
            group, _, name = metric.key.partition(".")
            ours, theirs = (part[group][name] if name else part[group] for part in (summary, alone))
            # A missing value is None for a single run and a None per joint for a batch.
            expected = [None, None] if theirs is None else theirs
            known = engine == "native" or expected is None or None in np.atleast_1d(expected)
            assert ours[i] == (expected if known else pytest.approx(expected, rel=1e-6)), metric.key
    steady = analysis.steady_error(many)
    assert steady is not None and steady.shape == (3, 2)
    assert np.ma.getmaskarray(steady).tolist() == [[False] * 2, [True] * 2, [True] * 2]
    assert not np.isnan(np.ma.getdata(steady)).any()
    assert analysis.envelope_violations(many).tolist() == [0, 1, 1]
    assert analysis.settling_time(many, 1e-2).shape == (3, 2)
    json.dumps(summary, allow_nan=False)


def test_user_metric_appears_with_title_unit_and_meaning_in_summary_and_comparison():
    @analysis.metric("largest error", "{position}", bars=True, brief=True)
    def largest_error(run: Run) -> np.ndarray:
        """`max |e|` over the log."""
        return np.abs(run.log.e).max(axis=0)

    run = whole()
    assert (largest_error.key, largest_error.title, largest_error.meaning) == (
        *("largest_error", "largest error", "max |e| over the log"),
    )
    assert largest_error.units(run) == ["rad", "rad"]
    assert analysis.summary(run, [largest_error])["largest_error"] == largest_error(run).tolist()
    scenario = scenarios.load("example-4.1")
    rows = standings({"one": Rival(scenario, run), "two": Rival(scenario, run)}, [largest_error])
    assert [row.unit for row in rows if row.metric is largest_error] == ["rad", "rad"]


def test_every_metric_is_exported_with_a_unique_title_and_a_meaning():
    metrics = (*analysis.metrics_of(whole()), *INDEX_SUMS)
    for field in ("key", "title"):
        assert len({getattr(metric, field) for metric in metrics}) == len(metrics)
    assert all(metric.meaning and not metric.meaning.endswith(".") for metric in metrics)
    exported = [thing for thing in vars(analysis).values() if isinstance(thing, analysis.Metric)]
    listed = {*analysis.METRICS, *analysis.TOOL_METRICS, *analysis.TOLERANCE_METRICS, *analysis.MONITOR_METRICS}
    assert set(exported) == listed, "a metric needs its line in analysis/__init__.py"
    scara = scenarios.load("example-4.2", {"simulation.t1": 0.01}).simulate(log_every=None)
    assert analysis.torque_energy.units(scara) == ["(N m)² s", "(N m)² s", "N² s"]
    assert analysis.iae.units(scara) == ["rad s", "rad s", "m s"]


def test_summary_of_a_run_without_valid_samples_has_null_instead_of_nan():
    start = scenarios.load("example-4.1", {"simulation.t1": 0.01}).simulate(log_every=None)
    empty = eqx.tree_at(lambda r: r.tally, start, Tally.empty(2, 5))
    text = json.dumps(analysis.summary(empty, INDEX_SUMS), allow_nan=False)
    assert '"envelope_margin": null' in text and '"rms_error": null' in text


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (("panda_joint1", "panda_joint2"), ["joint1", "joint2"]),
        (("shoulder_pan_joint", "elbow_joint"), ["shoulder_pan", "elbow"]),
        (("joint 1", "joint 2"), ["joint 1", "joint 2"]),
        (("iiwa_joint_1", "iiwa_joint_2"), ["iiwa_joint_1", "iiwa_joint_2"]),
        (("only_joint",), ["only_joint"]),
    ],
)
def test_joint_names_are_shortened_by_their_common_words(names, short):
    assert analysis.short_names(names) == short


def test_envelope_margin_is_the_smallest_distance_to_the_envelope_over_its_width():
    run = whole()
    lower, upper = np.asarray(run.log.envelope.lower), np.asarray(run.log.envelope.upper)
    nearer = np.minimum(run.log.e - lower, upper - run.log.e) / (upper - lower)
    np.testing.assert_allclose(analysis.envelope_margin(run), nearer.min(0), rtol=1e-12)
    assert analysis.envelope_violations(run) == 0


def test_run_that_ends_early_has_no_steady_state_metrics_but_keeps_the_others():
    run = scenarios.load("example-4.1", {"simulation.period": 1e-3}).simulate(log_every=None)
    assert run.outcome.kind == "left_envelope"
    assert analysis.steady_error(run) is None and analysis.steady_torque_step(run) is None
    assert analysis.steady_torque_step_rms(run) is None and np.isfinite(analysis.peak_torque(run)).all()
    text = json.dumps(analysis.summary(run), allow_nan=False)
    assert '"steady_error": null' in text


def test_run_that_left_its_envelope_counts_violations_and_has_a_negative_margin():
    changes = {"start.q": [-0.8, 2.9], "simulation.t1": 1.0}
    run = scenarios.load("example-4.1-1khz", changes).simulate(log_every=1)
    assert run.outcome.kind == "recovered"
    lower, upper = np.asarray(run.log.envelope.lower), np.asarray(run.log.envelope.upper)
    nearer = np.minimum(run.log.e - lower, upper - run.log.e)
    assert analysis.envelope_violations(run) == np.sum((nearer <= 0).any(axis=1)) > 100
    np.testing.assert_allclose(analysis.envelope_margin(run), (nearer / (upper - lower)).min(0), rtol=1e-12)
    assert np.all(analysis.envelope_margin(run) < 0)


def test_the_summary_is_plain_json_with_short_band_names():
    summary = analysis.summary(whole())
    assert list(summary["settling_time"]) == ["1e-2", "1e-3", "1e-4", "1e-5", "1e-8"]
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


KINDS = ("pandas", "polars")


@pytest.fixture(scope="module")
def run():
    return scenarios.load("example-4.1-1khz", {"simulation.t1": 0.1}).simulate(log_every=10)


@pytest.mark.parametrize("kind", KINDS)
def test_a_log_has_the_same_columns_in_pandas_and_polars(run, kind):
    pytest.importorskip(kind)
    frame = run.frame(kind)
    assert list(frame.columns) == list(run.units())
    np.testing.assert_array_equal(frame["e[joint 2]"].to_numpy(), run.log.e[:, 1])
    np.testing.assert_array_equal(frame["t"].to_numpy(), run.log.t)
    assert run.units()["dq[joint 1]"] == "rad/s" and run.units()["tau[joint 1]"] == "N m"
    numbered = run.frame(kind, joints="numbers")
    assert "q_1" in numbered.columns and "q[joint 1]" not in numbered.columns
    np.testing.assert_array_equal(numbered["q_2"].to_numpy(), frame["q[joint 2]"].to_numpy())
    if kind == "pandas":
        assert frame.attrs["units"] == run.units()


@pytest.mark.parametrize("kind", KINDS)
def test_metrics_frame_has_a_row_per_run_metric_and_joint(run, kind):
    pytest.importorskip(kind)
    frame = analysis.metrics_frame({"one": run, "other": run}, kind)
    assert list(frame.columns) == ["run", "metric", "joint", "unit", "value"]
    rows = [
        dict(zip(frame.columns, row, strict=True)) for row in (frame.rows() if kind == "polars" else frame.to_numpy())
    ]
    (peak,) = (r for r in rows if (r["run"], r["metric"], r["joint"]) == ("other", "peak_torque", "joint 2"))
    assert peak["value"] == analysis.peak_torque(run)[1] and peak["unit"] == "N m"
    (outside,) = (r for r in rows if (r["run"], r["metric"]) == ("one", "envelope_violations"))
    assert outside["value"] == 0 and outside["joint"] == ""
    absent = [r["value"] for r in rows if r["metric"] == "settling_time.1e-8"]
    assert all(value is None or np.isnan(value) for value in absent) and absent


@pytest.mark.parametrize("kind", KINDS)
def test_study_frame_keeps_its_columns_and_has_units_in_pandas(kind):
    pytest.importorskip(kind)
    columns = {"row": np.arange(3), "margin": np.array([0.1, np.nan, 0.3]), "steady_error": np.ones(3)}
    frame = studies.frame(columns, kind)
    assert list(frame.columns) == list(columns) and len(frame) == 3
    if kind == "pandas":
        assert frame.attrs["units"] == {"row": "", "margin": "", "steady_error": "rad or m"}


def test_unknown_or_missing_data_frame_library_is_refused_with_a_remedy(monkeypatch):
    with pytest.raises(DefinitionError, match='must be "pandas" or "polars"'):
        inspect.unwrap(data_frame)({}, "arrow")
    monkeypatch.setitem(__import__("sys").modules, "polars", None)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[frame\]'"):
        data_frame({}, "polars")


HOW: dict[str, Any] = {"t1": 0.2, "period": 2e-3, "log_every": None}
SMOOTH = [metric for metric in (*METRICS, *INDEX_SUMS) if not metric.counts]
COUNTING = [analysis.envelope_violations, analysis.tolerance_violations, analysis.warned_at]


def define(stiffness: Any) -> Any:
    spring = Spring(stiffness=stiffness * jnp.array([300.0, 200.0]), damping=jnp.array([30.0, 20.0]))
    return SMOOTH_PLANT, BoundedLaw(spring=spring, radius=jnp.array([2.0, 2.0])), MOTION_4_1, START_4_1


def sums(run: Run) -> dict[str, Any]:
    return {metric.key: jnp.sum(jnp.asarray(metric(run))) for metric in SMOOTH}


def test_the_gradient_of_every_continuous_metric_matches_differences():
    at, h = jnp.asarray(1.0), 1e-5
    _, slopes = jax.jit(lambda x: jax.jvp(lambda x: sums(simulate(*define(x), **HOW)), (x,), (jnp.ones(()),)))(at)
    high, low = (sums(simulate(*define(at + shift), **HOW)) for shift in (h, -h))
    assert len(slopes) >= 12
    for key, slope in slopes.items():
        assert float(slope) == pytest.approx(float(high[key] - low[key]) / (2 * h), rel=1e-4, abs=1e-9), key
    assert sum(abs(float(slope)) > 1e-6 for slope in slopes.values()) >= 10


@pytest.mark.full
def test_reverse_mode_and_native_gradients_of_a_metric_agree():
    def total(run: Run) -> Any:
        return jnp.sum(jnp.asarray(analysis.rms_error(run)))

    at = jnp.asarray(1.0)
    reverse = jax.grad(lambda x: total(simulate(*define(x), **HOW)))(at)
    how = {name: value for name, value in HOW.items() if name != "log_every"}
    value, ours = value_and_gradient(total, define, at, **how)
    assert float(value) == pytest.approx(float(total(simulate(*define(at), **HOW))), rel=1e-12)
    assert float(ours) == pytest.approx(float(reverse), rel=1e-8)


@cache
def finished() -> Run:
    return simulate(*define(jnp.asarray(1.0)), **HOW)


def traced(metric: Any) -> Any:
    """A metric of a run whose tally is traced by JAX."""
    run = finished()
    return jax.eval_shape(lambda tally: metric(eqx.tree_at(lambda run: run.tally, run, tally)), run.tally)


@pytest.mark.parametrize("metric", [*COUNTING, lambda run: analysis.settling_time(run, 1e-2)])
def test_gradient_of_a_metric_that_counts_samples_is_refused_with_its_name(metric):
    name = metric.key if isinstance(metric, Metric) else "settling_time"
    with pytest.raises(DefinitionError, match=f"`{name}` counts samples, and so has no derivative"):
        traced(metric)


def test_gradient_of_a_user_metric_in_numpy_is_refused_with_its_name():
    @analysis.metric("largest error", "{position}")
    def largest(run: Run) -> np.ndarray:
        """`max |e|`."""
        return np.asarray(run.tally.steady_error)

    with pytest.raises(DefinitionError, match=r"`largest` uses NumPy.*`slidax\.analysis\.arrays\(run\)`"):
        traced(largest)
    np.testing.assert_array_equal(largest(finished()), analysis.steady_error(finished()))


def test_the_rms_of_a_zero_error_has_gradient_zero():
    assert float(jax.grad(lambda x: safe_sqrt(jnp, x * x))(0.0)) == 0.0
    assert float(jax.grad(lambda x: safe_sqrt(jnp, x * x))(-2.0)) == -1.0
