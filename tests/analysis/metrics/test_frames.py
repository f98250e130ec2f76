"""Logs, metrics and rows of studies as data frames of pandas and polars, with the same columns."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from slidax import analysis, scenarios, studies
from slidax.core.errors import DefinitionError
from slidax.simulation import Run
from slidax.simulation.run import data_frame

KINDS = ("pandas", "polars")


@pytest.fixture(scope="module")
def run() -> Run:
    return scenarios.load("example-4.1-1khz", {"simulation.t1": 0.1}).simulate(log_every=10)


@pytest.mark.parametrize("kind", KINDS)
def test_a_log_has_the_same_columns_in_both(run, kind):
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
def test_metrics_are_a_row_for_each_number(run, kind):
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
def test_many_runs_are_numbered_and_rows_of_studies_have_units(kind):
    pytest.importorskip(kind)
    columns = {"row": np.arange(3), "margin": np.array([0.1, np.nan, 0.3]), "steady_error": np.ones(3)}
    frame = studies.frame(columns, kind)
    assert list(frame.columns) == list(columns) and len(frame) == 3
    if kind == "pandas":
        assert frame.attrs["units"] == {"row": "", "margin": "", "steady_error": "rad or m"}


def test_another_library_is_refused(monkeypatch):
    with pytest.raises(DefinitionError, match='of "pandas" or of "polars"'):
        inspect.unwrap(data_frame)({}, "arrow")
    monkeypatch.setitem(__import__("sys").modules, "polars", None)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[frame\]'"):
        data_frame({}, "polars")
