"""Sweep, falsify, sensitivity, compare and tune on one small family."""

import json
import warnings
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.report import write_scenario, write_study_report
from slidax.studies import RunOptions, read_study, study_of
from slidax.studies.cases import columns_of
from slidax.studies.falsify import rank_badness
from slidax.studies.predicates import Predicate
from slidax.studies.sensitivity import sobol_indices
from slidax.studies.sweep import one_number
from slidax.studies.tune import distinct_ends, evaluate_aims, point_of_own_values
from tests.studies.files import SHORT, SMALL_SETS, result_of, study_of_kind, weak

pytest.importorskip("cmaes")
pytest.importorskip("llvmlite")
pytest.importorskip("SALib")


@pytest.fixture(scope="module")
def swept():
    over = {
        "scheme.performance.final": {"between": [5e-4, 2e-3], "distribution": "log_uniform"},
        "disturbance.scale": {"choice": [0.0, 1.0]},
    }
    return result_of("sweep", over=over, points=3, of="peak_torque", uncertainty={})


def test_each_point_of_a_sweep_map_equals_the_run_with_its_values(swept):
    assert swept.worst.shape == swept.shape == (3, 2)
    finals, scales = map(one_number, swept.axes.values())
    np.testing.assert_allclose(finals, [5e-4, 1e-3, 2e-3], rtol=1e-12)
    assert scales.tolist() == [0.0, 1.0]
    for i, j in ((0, 1), (2, 0)):
        values = {"scheme.performance.final": float(finals[i]), "disturbance.scale": float(scales[j])}
        item = scenarios.load("example-4.1-1khz", SHORT | values).simulate(log_every=None, progress=False)
        assert columns_of(item)["peak_torque"][0] == swept.worst[i, j]


def test_page_of_a_sweep_has_the_map_and_its_points(swept):
    (section,) = swept.sections()
    assert [picture.name for picture in section.figures] == ["map"]
    assert len(section.rows) == 6 and section.rows[1][-2] == swept.worst[0, 1]
    assert swept.as_json()["map"][2][1] == swept.worst[2, 1]
    assert swept.summary.startswith("3 x 2 points, 6 runs: no run fails at 6 of 6")


def test_the_worst_of_a_margin_in_a_sweep_is_its_least_value(swept):
    margins = np.array([0.3, 0.1, 0.5, 0.2, 0.4, 0.6, 0.9, 0.8, 0.7, 1.0, 0.25, 0.15])
    table = {"outcome": np.zeros(12, int), "envelope_margin": margins, "steady_error": margins}
    worst = {}
    for of in ("envelope_margin", "steady_error"):
        study = swept.study.model_copy(update={"of": of})
        worst[of] = replace(swept, study=study, table=table).worst.ravel().tolist()
    assert worst["envelope_margin"] == [0.1, 0.2, 0.4, 0.8, 0.7, 0.15]
    assert worst["steady_error"] == [0.3, 0.5, 0.6, 0.9, 1.0, 0.25]


def test_a_falsification_ranks_a_smaller_margin_and_a_larger_error_as_worse():
    table = {"outcome": np.zeros(3, int), "t": np.ones(3), "tolerance_margin": np.array([0.3, 0.1, -0.2])}
    table["steady_error"] = table["tolerance_margin"]
    assert np.argsort(rank_badness(table, "tolerance_margin")).tolist() == [2, 1, 0]
    assert np.argsort(rank_badness(table, "steady_error")).tolist() == [0, 1, 2]


@pytest.mark.full
def test_a_sweep_over_the_period_gives_a_finite_error_for_each_period():
    periods = result_of(
        "sweep", over={"simulation.period": {"choice": [1e-3, 2e-3]}}, of="steady_error", uncertainty={}
    )
    assert periods.worst[0] != periods.worst[1] and np.isfinite(periods.worst).all()


@pytest.mark.full
def test_all_points_of_a_sweep_have_the_same_cases():
    over = {"robot.plant.inertias": {"between": [4.5, 5.5]}}
    maps = result_of("sweep", over=over, points=2, cases=4, law="not told")
    starts = maps.table["start.q[0]"].reshape(2, 4)
    np.testing.assert_array_equal(starts[0], starts[1])
    assert len(set(starts[0])) == 4
    np.testing.assert_array_equal(maps.table["robot.plant.inertias[0]"], np.repeat([4.5, 5.5], 4))
    assert maps.worst.tolist() == maps.table["margin"].reshape(2, 4).min(axis=1).tolist()


EXAMPLES = Path(__file__).parents[2] / "examples" / "studies"


@pytest.fixture(scope="module")
def violation():
    return weak("falsify", 28, runs=600, until="violation")


def test_falsification_ends_its_search_at_a_violation(violation):
    assert violation.ended.startswith("a violation was found") and violation.runs < 600 and not violation.good
    text = violation.as_json()
    assert (text["kind"], text["failures"]) == ("falsify", violation.failures)
    assert text["worst"]["margin"] < 0.0 and text["found"][0]["outcome"] == "recovered"
    json.dumps(text, allow_nan=False)


def test_each_worst_case_is_a_scenario_that_reproduces_its_results(violation, tmp_path):
    for name, row in zip(violation.names, violation.rows, strict=True):
        write_scenario(violation.scenarios()[name], tmp_path / f"{name}.yaml")
        again = columns_of(scenarios.load(tmp_path / f"{name}.yaml").simulate(log_every=None, progress=False))
        for key in ("outcome", "margin", "steady_error", "peak_torque"):
            assert again[key][0] == violation.table[key][row]


def test_the_reported_worst_cases_keep_the_required_distance_and_are_sorted():
    worst = result_of("falsify", runs=160, keep=3, apart=0.3)
    assert len(worst.rows) == 3
    points = worst.search.points
    assert min(np.abs(points[i] - points[j]).max() for i in range(3) for j in range(i)) >= 0.3
    assert worst.table["margin"][list(worst.rows)].tolist() == sorted(worst.table["margin"][list(worst.rows)])
    assert worst.table["margin"].min() == worst.table["margin"][worst.rows[0]]


def test_falsification_maximizes_a_chosen_metric():
    worst = result_of("falsify", runs=160, worst="peak_torque")
    assert worst.table["peak_torque"][worst.rows[0]] == worst.table["peak_torque"].max()
    assert worst.as_json()["worst"]["peak_torque"] == worst.table["peak_torque"].max()
    assert worst.search.stop == "evaluations" and "the worst peak_torque is " in worst.summary


def test_an_interrupted_falsification_resumes_with_the_same_results(tmp_path):
    whole = result_of("falsify", runs=160)
    chunks = count()

    def stopped(_):
        if next(chunks) == 1:
            raise KeyboardInterrupt

    study = study_of_kind("falsify", runs=160)
    with pytest.raises(KeyboardInterrupt):
        study.run(RunOptions(tmp_path / "study", progress=stopped))
    resumed = study.run(RunOptions(tmp_path / "study", resume=True))
    assert 0 < resumed.computed < whole.runs
    for name, column in whole.table.items():
        np.testing.assert_array_equal(resumed.table[name], column)


def test_page_of_a_falsification_has_the_worst_cases_and_the_search(violation):
    sections = violation.sections()
    assert [section.title for section in sections][:2] == ["The worst cases", "Dependence of the margin"]
    assert sections[0].rows[0][0] == "worst.yaml" and sections[0].figures[0].name == "search"
    assert all(len(row) == len(section.head) for section in sections for row in section.rows)


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "mended"),
    [
        ("weak-drives", {"actuator.torque": 60}),
        ("scara-drives", {"actuator.torque": 20}),
        ("weak-wrist", {"actuator.torque": "robot"}),
    ],
)
def test_falsification_detects_failures_that_ten_thousand_random_runs_miss_and_none_after_repair(name, mended):
    study = read_study(EXAMPLES / f"falsify-{name}.yaml")
    text = study.model_dump(include={"scenario", "changes", "uncertainty"}, exclude_unset=True)
    random = study_of({**text, "study": "monte_carlo", "runs": 10_000}).run(RunOptions())
    assert random.rates[0].failures == 0
    worst = study.run(RunOptions())
    assert worst.failures > 0 and worst.table["margin"].min() < -0.02
    held = study.model_copy(update={"changes": {**study.changes, **mended}}).run(RunOptions())
    assert held.good and held.table["margin"].min() > 0.02


@pytest.fixture(scope="module")
def shares():
    return result_of("sensitivity", base=64, of=["margin", "peak_torque"])


@pytest.mark.full
def test_the_margin_of_a_short_run_depends_on_the_start_alone(shares):
    assert shares.runs == 64 * (4 + 2)
    assert shares.names == ("robot.plant.masses", "robot.plant.inertias", "disturbance.scale", "start.q")
    margin = shares.indices["margin"]
    assert margin.total[3] > 0.8 and margin.total[:3].max() < 0.05
    assert "runs: start.q accounts for" in shares.summary and "% of the variance of `margin`" in shares.summary


def test_the_indices_follow_from_the_rows_of_the_study(shares):
    again = sobol_indices(shares.table["peak_torque"], [1, 2, 1, 2])
    np.testing.assert_array_equal(again.total, shares.indices["peak_torque"].total)
    rows = shares.as_json()["indices"]["peak_torque"]
    assert [row["total"] for row in rows] == again.total.tolist()


def test_each_uncertain_number_can_have_its_own_index():
    each = result_of("sensitivity", base=8, of=["peak_torque"], each="number")
    assert each.names[1:3] == ("robot.plant.inertias[0]", "robot.plant.inertias[1]")
    assert each.runs == 8 * (6 + 2)


def test_page_of_a_sensitivity_has_a_table_and_a_picture_for_each_result(shares):
    assert [section.title for section in shares.sections()] == ["Dependence of margin", "Dependence of peak_torque"]
    assert [picture.name for section in shares.sections() for picture in section.figures] == [
        "shares-margin",
        "shares-peak_torque",
    ]


SCHEMES = {
    "ours": {},
    "the_same": {"scheme.surface.k1": 0.2},
    "slower": {"scheme.surface.k1": 0.02, "scheme.surface.k2": 0.05},
    "computed_torque": {"scheme.name": "computed_torque"},
}


@pytest.fixture(scope="module")
def compared():
    inside = {**SMALL_SETS, "start": {"inside": "envelope", "share": 0.5}}
    del inside["start.q"]
    return result_of("compare", schemes=SCHEMES, runs=24, uncertainty=inside)


@pytest.mark.full
def test_all_schemes_have_the_same_cases_also_for_starts_inside_the_first_envelope(compared):
    tables = list(compared.tables.values())
    for name in ("robot.plant.masses[0]", "start.q[0]", "start.q[1]", "disturbance.scale"):
        for table in tables[1:]:
            np.testing.assert_array_equal(tables[0][name], table[name])
    assert np.ptp(tables[0]["start.q[0]"]) > 0.1


def test_a_scheme_does_not_differ_from_itself(compared):
    same = compared.difference("the_same", "steady_error")
    assert (same.mean, same.p_value, same.significant) == (0.0, 1.0, False)
    assert compared.shares("the_same", "envelope").difference == 0.0


def test_a_slower_scheme_is_worse_in_the_paired_comparison(compared):
    slower = compared.difference("slower", "steady_error")
    assert slower.pairs == 24 and slower.of_mean.lower > 0.0
    ours, theirs = (compared.tables[name]["steady_error"] for name in ("slower", "ours"))
    assert slower.mean == pytest.approx(np.mean(ours - theirs))
    assert "slower is better in peak_torque and worse in steady_error" in compared.summary


def test_a_scheme_with_larger_margins_is_better_in_the_comparison(compared):
    both = replace(compared, of=("envelope_margin",))
    assert both.difference("slower", "envelope_margin").of_mean.lower > 0.0
    assert "slower is better in envelope_margin" in both.summary


def test_a_scheme_without_an_envelope_is_compared_by_the_other_metrics(compared):
    assert compared.rate("computed_torque", "envelope") == (None, None)
    assert compared.shares("computed_torque", "envelope") is None
    assert compared.difference("computed_torque", "peak_torque").pairs == 24


def test_the_page_and_json_of_a_comparison_contain_all_schemes(compared):
    text = compared.as_json()
    assert text["reference"] == "ours" and list(text["schemes"]) == list(SCHEMES)
    assert text["schemes"]["slower"]["differences"]["steady_error"]["interval"]["lower"] > 0.0
    json.dumps(text, allow_nan=False)
    rates, differences = compared.sections()
    assert len(rates.rows) == 4 and len(differences.rows) == 3 * 3
    assert all(len(row) == len(section.head) for section in (rates, differences) for row in section.rows)


GAINS = {
    "scheme.surface.k1": {"between": [0.05, 2.0], "distribution": "log_uniform"},
    "scheme.surface.k2": {"between": [0.1, 4.0], "distribution": "log_uniform"},
}
HOW = {"gains": GAINS, "cases": 4, "candidates": 80, "held_out": 24, "keep": 5, "aims": ["steady_error", "peak_torque"]}


@pytest.fixture(scope="module")
def tuned():
    return result_of("tune", **HOW)


@pytest.mark.full
def test_tuned_gains_beat_the_current_gains_on_held_out_cases(tuned):
    assert tuned.best is not None and tuned.good
    difference = tuned.difference(tuned.best, "steady_error")
    assert difference.pairs == 24 and difference.of_mean.upper < 0.0
    assert np.all(tuned.front.aims[tuned.best] <= tuned.before * (1 + 1e-9))


def test_all_candidates_and_the_current_gains_have_the_same_cases(tuned):
    starts = tuned.table["start.q[0]"][: 80 * 4].reshape(80, 4)
    assert np.all(starts == starts[0]) and len(set(starts[0])) == 4
    held_out = tuned.table["start.q[0]"][80 * 4 :].reshape(-1, 24)
    assert np.all(held_out == tuned.today["start.q[0]"]) and not set(held_out[0]) & set(starts[0])


def test_the_tuning_search_begins_at_the_current_gains(tuned):
    np.testing.assert_allclose(tuned.front.start, tuned.before, rtol=1e-9)
    own = tuned.family.varied.values(point_of_own_values(tuned.family.varied)[None])
    np.testing.assert_allclose([own[path][0] for path in GAINS], [0.2, 0.6], rtol=1e-9)


def test_a_scenario_of_the_front_has_the_gains_in_the_result(tuned, tmp_path):
    write_scenario(tuned.scenarios()["front-1"], tmp_path / "front-1.yaml")
    built = scenarios.load(tmp_path / "front-1.yaml").description.scheme
    surface = built.surface
    assert {"scheme.surface.k1": surface.k1, "scheme.surface.k2": surface.k2} == tuned.gains[0]


def test_required_predicates_hold_in_every_case_of_the_front(tuned):
    errors = tuned.table["steady_error"][: 80 * 4].reshape(80, 4).max(axis=1)
    limit = float(np.median(errors))
    strict = result_of("tune", **HOW, holds=["envelope", f"steady_error < {limit}"])
    errors = strict.table["steady_error"][: 80 * 4].reshape(80, 4).max(axis=1)
    assert 0 < strict.front.holding == np.sum(errors < limit) < 80
    nothing = result_of("tune", **HOW, holds=["peak_torque < 1e-3"])
    assert nothing.best is None and "none of 80 candidates" in nothing.summary
    assert nothing.as_json()["best"] is None and nothing.scenarios() == {} and nothing.sections()


def test_a_candidate_is_infeasible_if_a_case_fails_or_has_too_little_margin():
    rows = {
        "outcome": np.array([0, 0, 0, 1, 0, 0]),
        "margin": np.array([0.3, 0.2, 0.4, -0.5, 0.3, 0.04]),
        "steady_error": np.array([1.0, 3.0, 5.0, 5.0, 2.0, 4.0]),
    }
    result = evaluate_aims(rows, 2, ["steady_error"], [Predicate("envelope")], 0.05)
    assert result.aims[:, 0].tolist() == [2.0, 5.0, 3.0]
    np.testing.assert_allclose(result.broken, [-0.15, 1.55, 0.01])
    with pytest.raises(DefinitionError, match=r"a larger `margin` is better: require it by `holds: margin > 0.1`"):
        evaluate_aims(rows, 2, ["margin"], [Predicate("envelope")], 0.05)


def test_gains_are_named_by_the_shortest_distinct_end_of_their_path():
    paths = ["scheme.surface.k1", "scheme.reaching.k1", "scheme.sampled_data.horizon", "k1"]
    assert distinct_ends(paths) == ["surface.k1", "reaching.k1", "horizon", "k1"]


def test_the_page_and_json_of_a_tuning_contain_the_front(tuned, tmp_path):
    text = tuned.as_json()
    assert len(text["front"]) == len(tuned.gains) and text["today"]["gains"] is None
    assert text["difference"]["steady_error"]["mean"] == tuned.difference(tuned.best, "steady_error").mean
    json.dumps(text, allow_nan=False)
    front, gains, comparison = tuned.sections()
    assert len(front.rows) == len(tuned.gains) + 1 and len(gains.rows) == len(tuned.gains)
    assert len(comparison.rows) == 2
    assert set(tuned.scenarios()) == {"best", *(f"front-{k + 1}" for k in range(len(tuned.gains)))}
    write_study_report(study_of_kind("tune", **HOW), tuned, tmp_path, seconds=1.0)
    assert (tmp_path / "figures" / "front.svg").exists()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_an_example_study_can_be_read_and_its_sets_exist(path):
    study = read_study(path)
    assert study.title
    if study.study == "sweep":
        # Some points of a map may cause a warning.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DefinitionWarning)
            assert len(study.over) == study._family().space.dimensions == 2
        return
    family = study.family(study.gains) if study.study == "tune" else study.family()
    assert family.space.dimensions > 3


REFUSED = [
    ("sweep", {"over": {}}, "over: must have >= 1 entry"),
    ("sweep", {"over": {"scheme.surface.k9": {"between": [0, 1]}}}, "scheme.surface.k9: there is no `k9` here"),
    (
        "sweep",
        {"over": {"robot.plant.masses": {"around": "5 %", "each": "joint"}}},
        "sweep a single value for all joints",
    ),
    ("sweep", {"over": {"disturbance.scale": {"between": [0, 1]}}, "of": "marginn"}, "did you mean `margin`"),
    ("sweep", {"over": {"disturbance.scale": {"between": [0, 1]}}, "points": 1}, "points: must be >= 2; got 1"),
    (
        "sweep",
        {"over": {"disturbance.scale": {"between": [0, 1]}}, "uncertainty": {}, "cases": 5},
        "cases: greater than 1 needs uncertain values",
    ),
    ("falsify", {"uncertainty": {}}, "uncertainty: is empty"),
    ("falsify", {"worst": "steady_eror"}, "did you mean `steady_error`"),
    ("falsify", {"worst": "peak_torque", "until": "violation"}, "until: is for `worst: margin`"),
    ("falsify", {"runs": 0}, "runs: must be >= 1; got 0"),
    ("falsify", {"apart": 0.0}, "apart: must be > 0; got 0"),
    ("falsify", {"keep": 0}, "keep: must be >= 1; got 0"),
    ("falsify", {"trials": 5}, "unknown key `trials`"),
    ("falsify", {"changes": SHORT | {"scheme.name": "computed_torque"}}, "search for `worst: steady_error`"),
    ("sensitivity", {"base": 100}, "base: must be a power of two"),
    ("sensitivity", {"of": ["peak_torqe"]}, "did you mean `peak_torque`"),
    ("sensitivity", {"of": []}, "of: must have >= 1 entry"),
    ("sensitivity", {"uncertainty": {}}, "uncertainty: is empty"),
    ("sensitivity", {"each": "joint"}, "each: unknown `joint`"),
    ("compare", {"schemes": {"ours": {}}}, "schemes: must have >= 2 entries"),
    ("compare", {"schemes": {"ours": {}, "../x": {}}}, "must be letters"),
    ("compare", {"schemes": {"ours": {}, "b": {"scheme.nam": "ftsmc"}}}, "schemes.b.scheme: unknown key `nam`"),
    ("compare", {"of": ["steady"]}, "there is no metric `steady`"),
    ("compare", {"holds": ["envelop"]}, "holds: must be `envelope`, or a metric, a sign and a number"),
    ("compare", {"uncertainty": {}}, "uncertainty: is empty"),
    ("tune", {"gains": {}}, "gains: must have >= 1 entry"),
    ("tune", {"gains": {"scheme.surface.k9": {"between": [0, 1]}}}, "scheme.surface.k9: there is no `k9` here"),
    ("tune", {"gains": {"scheme.surface.k1": {"between": [-1, 1]}}}, "`SmoothFixedTime.k1` must be > 0"),
    ("tune", {"gains": {"disturbance.scale": {"between": [0, 1]}}}, "among the uncertain and the varied"),
    ("tune", {"aims": ["speed"]}, "there is no metric `speed`"),
    ("tune", {"candidates": 0}, "candidates: must be >= 1; got 0"),
    ("tune", {"cases": 0}, "cases: must be >= 1; got 0"),
    ("tune", {"holds": ["fast"]}, "holds: must be `envelope`, or a metric, a sign and a number"),
    ("tune", {"aims": ["row"]}, "there is no metric `row`"),
    ("tune", {"aims": ["envelope_violations"]}, "`envelope_violations` counts samples and is 0 in a good run"),
    ("sweep", {"over": {"disturbance.scale": {"between": [0, 1]}}, "of": "outcome"}, "there is no metric `outcome`"),
    ("falsify", {"worst": "t"}, "there is no metric `t`"),
]
COMMON = {
    "sweep": {"points": 2},
    "falsify": {"runs": 20},
    "sensitivity": {"base": 2},
    "compare": {"runs": 2, "schemes": {"ours": {}, "the_same": {}}},
    "tune": {**HOW, "candidates": 8},
}


def test_points_of_a_sweep_that_diverged_are_among_the_worst_of_its_table():
    over = {"disturbance.scale": {"between": [0, 1]}}
    result = result_of("sweep", over=over, points=30, of="steady_error", uncertainty={})
    steady = np.array(result.table["steady_error"])
    steady[:] = np.arange(steady.size)
    steady[7] = np.nan
    rows = replace(result, table={**result.table, "steady_error": steady}).sections()[0].rows
    assert len(rows) == 20 and np.isnan(rows[0][-2]) and rows[1][-2] == steady.size - 1


@pytest.mark.parametrize(("kind", "changes", "message"), REFUSED)
def test_an_invalid_study_is_refused_in_one_line(kind, changes, message):
    with pytest.raises(DefinitionError) as error:
        result_of(kind, **{**COMMON[kind], **changes})
    assert message in str(error.value) and "\n" not in str(error.value)
