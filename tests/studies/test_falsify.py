"""The worst case is found where random cases miss it, is kept as a scenario that shows it again, and is found again."""

import json
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.report import write_scenario
from slidax.studies import RunOptions, read_study, study_of
from slidax.studies.cases import columns_of

from .kinds import SHORT, asked, found, weak

pytest.importorskip("cmaes")
pytest.importorskip("llvmlite")

EXAMPLES = Path(__file__).parents[2] / "examples" / "studies"


@pytest.fixture(scope="module")
def violation():
    return weak("falsify", 28, runs=600, until="violation")


def test_a_violation_is_found_and_ends_the_search(violation):
    assert violation.ended.startswith("a violation was found") and violation.runs < 600
    assert not violation.good
    text = violation.as_json()
    assert (text["kind"], text["failures"]) == ("falsify", violation.failures)
    assert text["worst"]["margin"] < 0.0 and text["found"][0]["outcome"] == "recovered"
    json.dumps(text, allow_nan=False)


def test_the_worst_case_is_a_scenario_that_shows_it_again(violation, tmp_path):
    for name, row in zip(violation.names, violation.rows, strict=True):
        write_scenario(violation.scenarios()[name], tmp_path / f"{name}.yaml")
        again = columns_of(scenarios.load(tmp_path / f"{name}.yaml").simulate(log_every=None, progress=False))
        for key in ("outcome", "margin", "steady_error", "peak_torque"):
            assert again[key][0] == violation.table[key][row]


def test_the_cases_that_are_kept_are_apart():
    worst = found("falsify", runs=160, keep=3, apart=0.3)
    assert len(worst.rows) == 3
    points = worst.search.points
    assert min(np.abs(points[i] - points[j]).max() for i in range(3) for j in range(i)) >= 0.3
    assert worst.table["margin"][list(worst.rows)].tolist() == sorted(worst.table["margin"][list(worst.rows)])
    assert worst.table["margin"].min() == worst.table["margin"][worst.rows[0]]


def test_a_metric_can_be_searched():
    worst = found("falsify", runs=160, worst="peak_torque")
    assert worst.table["peak_torque"][worst.rows[0]] == worst.table["peak_torque"].max()
    assert worst.as_json()["worst"]["peak_torque"] == worst.table["peak_torque"].max()
    assert ("peak_torque" in worst.lead and worst.search.stop == "evaluations") or worst.search.stop == "settled"


def test_a_search_that_was_stopped_goes_on_where_it_was(tmp_path):
    whole = found("falsify", runs=160)
    chunks = count()

    def stopped(_):
        if next(chunks) == 1:
            raise KeyboardInterrupt

    study = asked("falsify", runs=160)
    with pytest.raises(KeyboardInterrupt):
        study.run(RunOptions(tmp_path / "study", progress=stopped))
    resumed = study.run(RunOptions(tmp_path / "study", resume=True))
    assert 0 < resumed.computed < whole.runs
    for name, column in whole.table.items():
        np.testing.assert_array_equal(resumed.table[name], column)


def test_its_page_has_the_worst_cases_and_the_way_of_the_search(violation):
    sections = violation.sections()
    assert [section.title for section in sections][:2] == ["The worst cases", "Dependence of the margin"]
    assert sections[0].rows[0][0] == "worst.yaml" and sections[0].figures[0].name == "search"
    assert all(len(row) == len(section.head) for section in sections for row in section.rows)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"uncertainty": {}}, "uncertainty: is empty"),
        ({"worst": "steady_eror"}, "did you mean `steady_error`"),
        ({"worst": "peak_torque", "until": "violation"}, "until: is for `worst: margin`"),
        ({"runs": 0}, "runs"),
        ({"apart": 0.0}, "apart"),
        ({"keep": 0}, "keep"),
        ({"trials": 5}, "unknown key `trials`"),
        ({"changes": SHORT | {"scheme.name": "computed_torque"}}, "search for `worst: steady_error`"),
    ],
)
def test_what_cannot_be_searched_is_said_in_a_line(said, message):
    with pytest.raises(DefinitionError) as error:
        found("falsify", **{"runs": 20, **said})
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "mended"),
    [
        ("weak-drives", {"actuator.torque": 60}),
        ("scara-drives", {"actuator.torque": 20}),
        ("weak-wrist", {"actuator.torque": "robot"}),
    ],
)
def test_it_finds_what_ten_thousand_random_runs_miss_and_nothing_in_the_mended_arm(name, mended):
    study = read_study(EXAMPLES / f"falsify-{name}.yaml")
    text = study.model_dump(include={"scenario", "changes", "uncertainty"}, exclude_unset=True)
    random = study_of({**text, "study": "monte_carlo", "runs": 10_000}).run(RunOptions())
    assert random.rates[0].failures == 0
    worst = study.run(RunOptions())
    assert worst.failures > 0 and worst.table["margin"].min() < -0.02
    held = study.model_copy(update={"changes": {**study.changes, **mended}}).run(RunOptions())
    assert held.good and held.table["margin"].min() > 0.02
