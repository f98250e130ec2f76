"""A small benchmark run, and rankings of results with a known order."""

from __future__ import annotations

import json
import os
import re
import sys

import numpy as np
import pytest

from slidax.core import PerJoint, matvec, parameter
from slidax.core.errors import DefinitionError
from slidax.core.types import Command
from slidax.law import Preset
from slidax.law.controllers import AbstractModelBased
from slidax.report.benchmark_page import percent, summarise_tasks, write_benchmark
from slidax.scenarios.family import Family
from slidax.scenarios.schemes import PRESETS
from slidax.studies.benchmark import BenchmarkEntry, BenchmarkRound, TaskResult, entries, forms_of, names, ranking, task
from slidax.studies.benchmark.entries import gains_of
from slidax.studies.benchmark.ranking import holm, rank_overall
from slidax.studies.benchmark.rounds import KEPT, Scale, costs, draw_cases, mark_failures, mark_inside
from tests.rivals import USERS_LAW


class Stiff(AbstractModelBased):
    """Computed torque without the velocity products."""

    kp: PerJoint = parameter("Kp", "1/s²", "> 0", default=400.0)
    kd: PerJoint = parameter("Kd", "1/s", "> 0", default=40.0)
    damping: PerJoint = parameter("D", "N m s/rad or N s/m", ">= 0", default=1.0)

    def __call__(self, t, state, reference_now, reference_next, memory):
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        wanted = reference_now.ddq - self.kp * e - self.kd * de
        tau = matvec(self.nominal.mass(state.q), wanted) + self.nominal.gravity(state.q) - self.damping * de
        return Command(tau=tau, memory=memory, signals={"e": e})


stiffer = Preset(Stiff, "The same, stiffer.", kp=900.0, kd=60.0, damping=2.0)

NOT_A_SCHEME = 3


STIFF = "tests.studies.test_benchmark:stiffer"

TASK = "scara-slow"


@pytest.fixture(scope="module")
def small():
    return BenchmarkRound({TASK: task(TASK)}, [*entries(["pid"], [STIFF], ("printed",))]).small()


@pytest.fixture(scope="module")
def results(small, tmp_path_factory):
    out = tmp_path_factory.mktemp("benchmark")
    return small.run(out, 0), out


def test_tasks_cover_every_arm_and_every_difficulty():
    tasks = [task(name) for name in names()]
    arms = {each.scenario["robot"]["kind"] for each in tasks}
    assert arms == {"two_link", "scara", "panda", "ur5e", "iiwa14", "xarm7", "gen3"}
    about = {word for each in tasks for word in each.about}
    assert {"payload", "friction", "rotors", "delay", "encoders", "pushes", "contact", "point to point"} <= about
    for each in tasks:
        assert each.training.seed != each.held_out.seed and each.held_out.cases >= 200


FITTING = [
    pytest.param(name, ["cftsmppc"] if daily else None, marks=[] if daily else [pytest.mark.full])
    for name in names()
    for daily in ((True, False) if name != TASK else (True,))
] + [pytest.param(TASK, None, id="all of them")]


@pytest.mark.parametrize(("name", "schemes"), FITTING)
def test_every_scheme_can_be_set_up_for_a_task_with_its_tolerance_as_envelope(name, schemes):
    for entry in entries(schemes):
        base = entry.described(task(name))
        assert base.tolerance is not None
        envelope = base.scheme.model_dump().get("transformation")
        if envelope is not None and "performance" in envelope:
            assert {"performance", "overshoot"} <= envelope.keys()
            assert {key: envelope[key] for key in ("performance", "overshoot")} == base.tolerance.model_dump()
        assert (base.scheme.sampled_data is not None) == (entry.form == "sampled-data")
        assert entry.gains().sets(base)


@pytest.mark.full
@pytest.mark.parametrize(
    ("scheme", "gains"),
    [
        ("computed_torque", {"scheme.kp": 1000.0, "scheme.kd": 60.0}),
        ("cftsmppc", {"scheme.surface.k1": 0.5, "scheme.surface.k2": 1.0, "scheme.bound.margin": 20.0}),
    ],
)
@pytest.mark.filterwarnings("ignore:scheme.bound, of the model error, gives u")
def test_tracking_errors_stay_below_a_tenth_of_armours_bound_with_the_heaviest_masses(scheme, gains):
    armour = task("gen3-armour")
    heavier = {"robot.plant.mass_factor": 1.03, "robot.plant.load.mass": 0.927}
    described = BenchmarkEntry(scheme, "sampled-data").described(armour).changed({**heavier, **gains})
    run = described.build(scheme).simulate(progress=False)
    # The bound is that of the public code: sqrt(2 V / sigma) / Kr.
    bound = (2.0 * 5e-5 / 5.095620491878957) ** 0.5 / 5.0
    assert np.isclose(armour.tolerance["performance"]["final"], bound, rtol=1e-3)
    assert run.outcome.ok and 0.0 < np.abs(run.log.e).max() < 0.1 * bound


def test_all_complete_schemes_are_benchmarked():
    assert {entry.scheme for entry in entries()} == {name for name, preset in PRESETS.items() if preset.complete}


def test_training_and_held_out_cases_are_disjoint():
    scara = task(TASK)
    family = Family.of(BenchmarkEntry("pid", "printed").described(scara), scara.uncertainty)
    training, held = (draw_cases(family, cases)["start.q"] for cases in (scara.training, scara.held_out))
    assert not np.isclose(training[:, None], held[None]).all(axis=2).any()


def test_benchmark_results_are_stored_and_recomputed_only_for_another_version(results, small):
    first, out = results
    assert len(first.by_key) == 2 and not any(isinstance(each, str) for each in first.by_key.values())
    for (_, entry), result in first.by_key.items():
        assert result.inside.shape == result.metrics["steady_error"].shape == (8,)
        assert set(result.gains) == {f"scheme.{path}" for path in entry.gains().tuned}
    again = small.run(out, 0, lambda *_: pytest.fail("it ran again"))
    for key, result in first.by_key.items():
        np.testing.assert_array_equal(again.by_key[key].inside, result.inside)
        for name, values in result.metrics.items():
            np.testing.assert_array_equal(again.by_key[key].metrics[name], values)
    file = next((out / "runs").rglob("*.json"))
    file.write_text(file.read_text().replace('"version": 1', '"version": 0'))
    ran = []
    small.run(out, 0, lambda *key: ran.append(key))
    assert len(ran) == 1


def test_the_benchmark_page_is_self_contained_and_names_versions_and_command(results):
    first, out = results
    page = write_benchmark(first, out, seconds=1.0, command="slidax benchmark --small").read_text(encoding="utf-8")
    assert not re.findall(r"https?://|\ssrc=|<link|<script", page)
    assert page.count("<figure") == 1 and "nan" not in page.lower().replace("nanometre", "")
    table = (out / "benchmark.md").read_text(encoding="utf-8")
    assert "`stiffer`" in table and f"- `{TASK}`: " in table and "slidax benchmark --small" in table and "jax" in table
    values = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert {each["scheme"] for each in values["tasks"][TASK]["schemes"]} == {"pid", STIFF}


def test_a_users_scheme_is_tuned_in_every_positive_parameter():
    entry = BenchmarkEntry(STIFF, "sampled-data")
    tuned = gains_of(STIFF, entry.preset, entry.form).tuned
    assert set(tuned) == {"kp", "kd", "damping"}
    assert tuned["kp"].between == (30.0, 27000.0) and tuned["kp"].times == "nothing"
    assert tuned["damping"].times == "inertia"
    assert entry.described(task("panda-payload")).scheme.name == "stiffer"


def test_an_error_in_a_users_law_is_reported_and_a_changed_law_runs_again(tmp_path, monkeypatch):
    file = tmp_path / "a_users_law.py"
    monkeypatch.syspath_prepend(tmp_path)
    wrong, right = USERS_LAW.replace("- self.kp", "- self.kq"), USERS_LAW
    for text, number in ((wrong, 1), (right, 2), (right, 2)):
        file.write_text(text, encoding="utf-8")
        os.utime(file, (number, number))
        sys.modules.pop("a_users_law", None)
        ran = []
        round_ = BenchmarkRound({TASK: task(TASK)}, entries([], ["a_users_law:Mine"], ("printed",))).small()
        (result,) = round_.run(tmp_path, 0, lambda *key, ran=ran: ran.append(key)).by_key.values()
        if text is wrong:
            line = next(i for i, code in enumerate(text.splitlines(), 1) if "self.kq" in code)
            assert result.startswith(f"line {line} of {file}, in `Mine.__call__`: AttributeError: ")
    assert isinstance(result, TaskResult) and not ran
    # Parameters in kg m² scale with the joints' inertia.
    assert np.shape(result.gains["scheme.inertia"]) == (3,) and np.shape(result.gains["scheme.kp"]) == ()


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (lambda: entries(["cftsmpc"]), "cftsmppc"),
        (lambda: entries([], ["tests.studies.test_benchmark:Missing"]), "cannot import"),
        (lambda: entries([], ["no.such.module:Law"]), "cannot import"),
        (
            lambda: entries([], ["tests.studies.test_benchmark:NOT_A_SCHEME"]),
            "neither a `Preset` nor the class of a law",
        ),
        (lambda: forms_of("sampled"), "sampled-data"),
        (lambda: task("scara-slwo"), "scara-slow"),
    ],
)
def test_an_unknown_name_is_refused_in_one_line(request_, text):
    with pytest.raises(DefinitionError, match=text) as refused:
        request_()
    assert "\n" not in str(refused.value)


FIRST, OTHER, THIRD = (BenchmarkEntry(name, "sampled-data") for name in ("cftsmppc", "pid", "ftsmc"))


def result(inside, error, failed=None):
    inside, error = np.asarray(inside, bool), np.asarray(error, float)
    failed = np.zeros(len(inside), bool) if failed is None else np.asarray(failed, bool)
    return TaskResult({}, 0.0, inside, failed, dict.fromkeys(KEPT, error), 1.0)


def test_a_scheme_with_clearly_more_cases_inside_ranks_first_despite_a_larger_error():
    rng = np.random.default_rng(0)
    table = ranking(
        "t", {FIRST: result([True] * 100, rng.uniform(2, 3, 100)), OTHER: result([False] * 100, np.ones(100))}
    )
    assert table.best.entry == FIRST and table.by == "share inside" and table.p_value < 1e-9
    assert not table.scores[1].leads and table.scores[1].interval.upper < 0.05


def test_paired_errors_decide_between_schemes_with_equal_shares_inside():
    rng = np.random.default_rng(1)
    error = rng.lognormal(size=200)
    inside = rng.random(200) < 0.95
    better = result(inside, 0.95 * error)
    table = ranking("t", {FIRST: result(inside, error), OTHER: better, THIRD: result(~inside, 0.1 * error)})
    # Unpaired, the variation between cases would hide a difference of 5 %.
    assert [score.entry for score in table.scores] == [OTHER, FIRST, THIRD]
    assert table.by == "steady error" and table.p_value < 1e-6
    assert [score.leads for score in table.scores] == [True, True, False]


@pytest.mark.full
def test_equal_schemes_differ_significantly_in_at_most_8_percent_of_comparisons():
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(200):
        pair = {entry: result(rng.random(60) < 0.9, rng.lognormal(size=60)) for entry in (FIRST, OTHER)}
        wrong += ranking("t", pair).p_value < 0.05
    # The better scheme is chosen after the runs, and share and error are both tested: still at most 8 %.
    assert wrong <= 16


def test_failed_cases_are_excluded_from_medians_and_a_missing_error_ranks_last():
    failed = [True] * 5 + [False] * 5
    half = result([False] * 5 + [True] * 5, [np.nan] * 5 + [1.0] * 5, failed)
    table = ranking("t", {FIRST: half, OTHER: result([False] * 10, [np.nan] * 10, [True] * 10)})
    scores = {score.entry: score for score in table.scores}
    assert scores[FIRST].medians["steady_error"] == 1.0 and scores[FIRST].failed == 0.5
    assert scores[OTHER].medians["steady_error"] is None
    (first, second) = rank_overall([table], [FIRST, OTHER])
    assert first.entry == FIRST and first.error == 1.0 and second.error is None
    assert "**cftsmppc (sampled-data)** is the best, with 50 % of the cases inside" in summarise_tasks([table])[0]


def test_a_task_whose_tolerance_no_scheme_keeps_has_no_best_scheme():
    table = ranking("t", {FIRST: result([False] * 9, np.ones(9)), OTHER: result([False] * 9, 2 * np.ones(9))})
    assert table.best is None and summarise_tasks([table]) == ["no scheme keeps the tolerance band in any case"]
    assert all(each.best == each.leads == 0 for each in rank_overall([table], [FIRST, OTHER]))


def test_holm_adjusted_p_values_match_a_worked_example():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    assert holm([]) == [] and holm([0.7, 0.9]) == [1.0, 1.0]


def columns(outcome, outside, error, margin=0.1, t=np.nan):
    numbers = {"tolerance_violations": outside, "steady_error": error, "tolerance_margin": margin, "t": t}
    return {"outcome": np.array([outcome]), "steady_torque_step": np.array([0.01])} | {
        name: np.array([float(value)]) for name, value in numbers.items()
    }


def test_tuning_costs_rank_cases_inside_then_cases_outside_then_cases_that_ended_early():
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


def test_a_share_is_printed_as_0_or_100_percent_only_if_exact():
    assert [percent(share) for share in (1.0, 0.9975, 0.5, 0.0025, 0.0)] == ["100 %", "99.8 %", "50 %", "0.2 %", "0 %"]
    assert [percent(share) for share in (0.99996, 0.0004)] == ["99.9 %", "0.1 %"]
