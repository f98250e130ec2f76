"""The benchmark as a whole, small: results that are kept, resumed and shown."""

import json
import re

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.report.benchmark_page import write_benchmark
from slidax.scenarios.family import Family
from slidax.scenarios.schemes import PRESETS
from slidax.studies.benchmark import BenchmarkEntry, BenchmarkRound, entries, forms_of, names, task
from slidax.studies.benchmark.entries import gains_of
from slidax.studies.benchmark.rounds import draw_cases

STIFF = "tests.studies.benchmark.entered:stiffer"

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
    for daily in (True, False)
] + [pytest.param(TASK, None, id="all of them")]


@pytest.mark.parametrize(("name", "schemes"), FITTING)
def test_every_scheme_fits_every_task_in_both_forms_with_the_same_tolerance(name, schemes):
    for entry in entries(schemes):
        base = entry.described(task(name))
        assert base.tolerance is not None
        envelope = base.scheme.model_dump().get("transformation")
        if envelope is not None and "performance" in envelope:
            assert {"performance", "overshoot"} <= envelope.keys()
            assert {key: envelope[key] for key in ("performance", "overshoot")} == base.tolerance.model_dump()
        assert (base.scheme.sampled_data is not None) == (entry.form == "sampled-data")
        assert entry.gains().sets(base)


def test_all_complete_schemes_take_part():
    assert {entry.scheme for entry in entries()} == {name for name, preset in PRESETS.items() if preset.complete}


def test_training_and_held_out_cases_are_disjoint():
    scara = task(TASK)
    family = Family.of(BenchmarkEntry("pid", "printed").described(scara), scara.uncertainty)
    training, held = (draw_cases(family, cases)["start.q"] for cases in (scara.training, scara.held_out))
    assert not np.isclose(training[:, None], held[None]).all(axis=2).any()


def test_a_round_is_kept_and_runs_again_only_for_another_version(results, small):
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


def test_the_page_stands_alone_and_the_table_names_versions_and_the_command(results):
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


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (lambda: entries(["cftsmpc"]), "cftsmppc"),
        (lambda: entries([], ["tests.studies.benchmark.entered:Missing"]), "cannot import"),
        (lambda: entries([], ["no.such.module:Law"]), "cannot import"),
        (
            lambda: entries([], ["tests.studies.benchmark.entered:NOT_A_SCHEME"]),
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
