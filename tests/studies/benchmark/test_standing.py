"""Rankings of results whose truth is known."""

import numpy as np
import pytest

from slidax.report.benchmark_page import percent, summarise_tasks
from slidax.studies.benchmark import BenchmarkEntry, TaskResult, ranking
from slidax.studies.benchmark.ranking import holm, rank_overall
from slidax.studies.benchmark.rounds import KEPT, Scale, costs, mark_failures, mark_inside

FIRST, OTHER, THIRD = (BenchmarkEntry(name, "sampled-data") for name in ("cftsmppc", "pid", "ftsmc"))


def result(inside, error, failed=None):
    inside, error = np.asarray(inside, bool), np.asarray(error, float)
    failed = np.zeros(len(inside), bool) if failed is None else np.asarray(failed, bool)
    return TaskResult({}, 0.0, inside, failed, dict.fromkeys(KEPT, error), 1.0)


def test_a_clearly_larger_share_wins_whatever_the_error():
    rng = np.random.default_rng(0)
    table = ranking(
        "t", {FIRST: result([True] * 100, rng.uniform(2, 3, 100)), OTHER: result([False] * 100, np.ones(100))}
    )
    assert table.best.entry == FIRST and table.by == "share inside" and table.p_value < 1e-9
    assert not table.scores[1].leads and table.scores[1].interval.upper < 0.05


def test_errors_decide_case_by_case_where_shares_may_be_equal():
    rng = np.random.default_rng(1)
    error = rng.lognormal(size=200)
    inside = rng.random(200) < 0.95
    better = result(inside, 0.95 * error)
    table = ranking("t", {FIRST: result(inside, error), OTHER: better, THIRD: result(~inside, 0.1 * error)})
    # Unpaired, five percent would drown in what the cases differ by.
    assert [score.entry for score in table.scores] == [OTHER, FIRST, THIRD]
    assert table.by == "steady error" and table.p_value < 1e-6
    assert [score.leads for score in table.scores] == [True, True, False]


@pytest.mark.full
def test_chance_alone_is_rarely_significant():
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(200):
        pair = {entry: result(rng.random(60) < 0.9, rng.lognormal(size=60)) for entry in (FIRST, OTHER)}
        wrong += ranking("t", pair).p_value < 0.05
    # Whichever comes out on top is called the better, and both ways to be so are tested: still below 8 %.
    assert wrong <= 16


def test_lost_cases_enter_no_median_and_a_missing_error_ranks_last():
    failed = [True] * 5 + [False] * 5
    half = result([False] * 5 + [True] * 5, [np.nan] * 5 + [1.0] * 5, failed)
    table = ranking("t", {FIRST: half, OTHER: result([False] * 10, [np.nan] * 10, [True] * 10)})
    scores = {score.entry: score for score in table.scores}
    assert scores[FIRST].medians["steady_error"] == 1.0 and scores[FIRST].failed == 0.5
    assert scores[OTHER].medians["steady_error"] is None
    (first, second) = rank_overall([table], [FIRST, OTHER])
    assert first.entry == FIRST and first.error == 1.0 and second.error is None
    assert "**cftsmppc (sampled-data)**, 50 % of the cases inside" in summarise_tasks([table])[0]


def test_a_task_that_no_scheme_keeps_has_no_best():
    table = ranking("t", {FIRST: result([False] * 9, np.ones(9)), OTHER: result([False] * 9, 2 * np.ones(9))})
    assert table.best is None and summarise_tasks([table]) == ["no scheme keeps the tolerance band in any case"]
    assert all(each.best == each.leads == 0 for each in rank_overall([table], [FIRST, OTHER]))


def test_holm_matches_his_paper():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    assert holm([]) == [] and holm([0.7, 0.9]) == [1.0, 1.0]


def columns(outcome, outside, error, margin=0.1, t=np.nan):
    numbers = {"tolerance_violations": outside, "steady_error": error, "tolerance_margin": margin, "t": t}
    return {"outcome": np.array([outcome]), "steady_torque_step": np.array([0.01])} | {
        name: np.array([float(value)]) for name, value in numbers.items()
    }


def test_costs_rank_a_case_inside_before_one_outside_before_one_that_ended_early():
    scale = Scale(initial=1.0, final=0.01, torque=10.0)
    cases = [
        columns(0, 0, 1e-4),
        columns(0, 0, 5e-3),
        columns(3, 4, 2e-3, margin=-0.1),
        columns(3, 400, 0.5, margin=-3.0),
        columns(2, 1, np.nan, margin=-1.0, t=3.0),
        columns(2, 1, np.nan, margin=-1.0, t=0.1),
    ]
    cost = [float(costs(case, scale)[0]) for case in cases]
    assert cost == sorted(cost) and len(set(cost)) == len(cost)
    assert cost[1] < 1.0 < cost[2] and cost[3] < 10.0 < cost[4]
    assert [bool(mark_inside(case)[0]) for case in cases] == [True, True, False, False, False, False]
    assert [bool(mark_failures(case, scale)[0]) for case in cases] == [False] * 4 + [True] * 2
    assert mark_failures(columns(0, 9, 1.5), scale)[0]


def test_a_share_is_0_or_100_percent_only_if_exact():
    assert [percent(share) for share in (1.0, 0.9975, 0.5, 0.0025, 0.0)] == ["100 %", "99.8 %", "50 %", "0.2 %", "0 %"]
