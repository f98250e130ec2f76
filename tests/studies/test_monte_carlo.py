"""Failure rates: exact counts and intervals, early stops, and reports as page and JSON."""

import json

import numpy as np
import pytest
from scipy.stats import binomtest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.report import write_scenario, write_study_report
from slidax.studies import Predicate, read_rows, scenario_of_row
from slidax.studies.cases import columns_of
from tests.studies.files import FAILING, ran, study


def test_the_failure_rate_follows_from_the_rows_with_the_exact_interval(tmp_path):
    result = ran(tmp_path / "out", holds=["steady_error < 0.2", "envelope"])
    rows = read_rows(tmp_path / "out")
    held = rows["steady_error"] < 0.2
    assert 0 < held.sum() < 200
    first = result.rates[0]
    assert first.failures == (~held).sum()
    exact = binomtest(int(held.sum()), 200).proportion_ci(0.99, "exact")
    assert (first.holding.lower, first.holding.upper) == pytest.approx((exact.low, exact.high), rel=1e-9)
    assert result.as_json()["probability"]["confidence"] == 0.99 and result.rates[1].failures == 0


def test_a_row_can_be_replayed_alone_bit_for_bit(tmp_path):
    result = ran(tmp_path / "out", runs=64)
    write_scenario(scenario_of_row(tmp_path / "out", 41), tmp_path / "case.yaml")
    again = columns_of(scenarios.load(tmp_path / "case.yaml").simulate(log_every=None))
    for name, value in again.items():
        assert np.array_equal(value[0], result.table[name][41], equal_nan=True), name
    with pytest.raises(DefinitionError, match="rows 0 to 63"):
        scenario_of_row(tmp_path / "out", 64)


def test_the_figure_and_the_table_use_the_same_joint_names():
    result = ran(runs=16, uncertainty={"start.q": {"around": 0.05, "each": "joint"}})
    (chart,) = [chart for section in result.sections() for chart in section.figures if chart.kind == "margin_over"]
    shown = list(chart.values[1])
    rows = {
        row[0]: row[1] for section in result.sections() if section.title == "The worst case" for row in section.rows
    }
    assert shown == ["start.q[joint 1]  [rad]", "start.q[joint 2]  [rad]"]
    assert rows == {f"start.q[joint {k + 1}]": result.table[f"start.q[{k}]"][result.worst] for k in range(2)}


def test_tables_have_the_unit_of_the_arm_and_failures_the_name_of_the_joint():
    sections = {section.title: section for section in ran(**FAILING).sections()}
    units = {row[0]: row[-1] for row in sections["Metrics"].rows}
    assert (units["steady error"], units["peak torque"]) == ("rad", "N m")
    assert [row[:2] for row in sections["Failures"].rows] == [("recovered", "joint 2")]


def test_a_sequential_study_stops_at_its_goal_or_at_a_failure():
    shown = ran(runs=3000, until={"probability": 0.98})
    assert "shown after" in shown.ended and shown.runs < 500 and shown.rates[0].holding.lower >= 0.98
    stopped = ran(runs=3000, holds=["steady_error < 0.2"], until={"probability": 0.999})
    assert "stopped at failure 1" in stopped.ended
    assert stopped.rates[0].failures == 1 and stopped.table["steady_error"][-1] >= 0.2
    assert "undecided after" in ran(runs=50, until={"probability": 0.999}).ended


def test_the_worst_case_is_a_scenario_that_replays_it_bit_for_bit(tmp_path):
    result = ran()
    page = write_study_report(study(), result, tmp_path, seconds=1.0, command="slidax study s.yaml")
    again = columns_of(scenarios.load(tmp_path / "worst.yaml").simulate(log_every=None))
    for name, value in again.items():
        assert np.array_equal(value[0], result.table[name][result.worst], equal_nan=True), name
    assert result.table["margin"][result.worst] == result.table["margin"].min()
    text = page.read_text(encoding="utf-8")
    assert "200 runs, none failed" in text and "robot.plant.masses" in text and "<svg" in text
    assert json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["runs"] == 200


def test_a_study_whose_runs_all_fail_reports_the_cause_once_with_counts():
    result = ran(**FAILING)
    assert result.rates[0].failures == 64 and result.why
    answer = result.as_json()
    assert answer["why"] == result.why and sum(item["runs"] for item in answer["causes"]) == 64
    assert sum(result.why in section.note for section in result.sections()) == 1


def test_a_predicate_holds_only_for_runs_that_reached_their_end():
    columns = {"outcome": np.array([0, 1, 2, 3]), "margin": np.zeros(4), "steady_error": np.full(4, 1e-4)}
    assert Predicate("steady_error < 1e-3").holds(columns).tolist() == [True, False, False, True]
    assert Predicate("envelope").holds(columns).tolist() == [True, False, False, False]
    assert Predicate("steady_error >= 1e-4").holds(columns).tolist() == [True, False, False, True]
    for bad in ("steady_error", "steady_error = 3", "< 3", "steady_error < x", ""):
        with pytest.raises(DefinitionError, match="steady_error < 1e-3"):
            Predicate(bad)
    with pytest.raises(DefinitionError, match="did you mean `steady_error`"):
        Predicate("stedy_error < 1").holds(columns)


def test_a_study_without_uncertainty_is_refused():
    with pytest.raises(DefinitionError, match="all runs would be the same"):
        ran(uncertainty={})
