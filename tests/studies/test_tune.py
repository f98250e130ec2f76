"""Gains are chosen on some cases, judged on others, and kept as scenarios."""

import json

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.report import write_scenario
from slidax.studies.predicates import Predicate
from slidax.studies.tune import evaluate_aims, point_of_own

from .kinds import found

pytest.importorskip("cmaes")
pytest.importorskip("llvmlite")

GAINS = {
    "scheme.surface.k1": {"between": [0.05, 2.0], "distribution": "log_uniform"},
    "scheme.surface.k2": {"between": [0.1, 4.0], "distribution": "log_uniform"},
}
HOW = {"gains": GAINS, "cases": 4, "candidates": 80, "held_out": 24, "keep": 5, "aims": ["steady_error", "peak_torque"]}


@pytest.fixture(scope="module")
def tuned():
    return found("tune", **HOW)


@pytest.mark.full
def test_the_best_gains_are_better_than_today_s_on_cases_that_the_search_has_not_seen(tuned):
    assert tuned.best is not None and tuned.good
    difference = tuned.difference(tuned.best, "steady_error")
    assert difference.pairs == 24 and difference.of_mean.upper < 0.0
    assert np.all(tuned.front.aims[tuned.best] <= tuned.before * (1 + 1e-9))


def test_all_candidates_and_today_s_gains_have_the_same_cases(tuned):
    starts = tuned.table["start.q[0]"][: 80 * 4].reshape(80, 4)
    assert np.all(starts == starts[0]) and len(set(starts[0])) == 4
    held_out = tuned.table["start.q[0]"][80 * 4 :].reshape(-1, 24)
    assert np.all(held_out == tuned.today["start.q[0]"]) and not set(held_out[0]) & set(starts[0])


def test_the_search_begins_at_today_s_gains(tuned):
    np.testing.assert_allclose(tuned.front.start, tuned.before, rtol=1e-9)
    own = tuned.family.varied.values(point_of_own(tuned.family.varied)[None])
    np.testing.assert_allclose([own[path][0] for path in GAINS], [0.2, 0.6], rtol=1e-9)


def test_a_scenario_of_the_front_has_the_numbers_that_are_said_of_it(tuned, tmp_path):
    write_scenario(tuned.scenarios()["front-1"], tmp_path / "front-1.yaml")
    built = scenarios.load(tmp_path / "front-1.yaml").description.scheme
    surface = built.surface
    assert {"scheme.surface.k1": surface.k1, "scheme.surface.k2": surface.k2} == tuned.gains[0]


def test_what_must_hold_in_every_case_does(tuned):
    errors = tuned.table["steady_error"][: 80 * 4].reshape(80, 4).max(axis=1)
    limit = float(np.median(errors))
    strict = found("tune", **HOW, holds=["envelope", f"steady_error < {limit}"])
    errors = strict.table["steady_error"][: 80 * 4].reshape(80, 4).max(axis=1)
    assert 0 < strict.front.holding == np.sum(errors < limit) < 80
    nothing = found("tune", **HOW, holds=["peak_torque < 1e-3"])
    assert nothing.best is None and "none of 80 candidates" in nothing.lead
    assert nothing.as_json()["best"] is None and nothing.scenarios() == {} and nothing.sections()


def test_a_candidate_is_out_if_one_of_its_cases_fails_or_has_too_little_margin():
    rows = {
        "outcome": np.array([0, 0, 0, 1, 0, 0]),
        "margin": np.array([0.3, 0.2, 0.4, -0.5, 0.3, 0.04]),
        "steady_error": np.array([1.0, 3.0, 5.0, 5.0, 2.0, 4.0]),
    }
    result = evaluate_aims(rows, 2, ["steady_error"], [Predicate("envelope")], 0.05)
    assert result.aims[:, 0].tolist() == [2.0, 5.0, 3.0]
    np.testing.assert_allclose(result.broken, [-0.15, 1.55, 0.01])


def test_its_page_and_its_answer_hold_the_front(tuned):
    text = tuned.as_json()
    assert len(text["front"]) == len(tuned.gains) and text["today"]["gains"] is None
    assert text["difference"]["steady_error"]["mean"] == tuned.difference(tuned.best, "steady_error").mean
    json.dumps(text, allow_nan=False)
    front, gains, beside = tuned.sections()
    assert len(front.rows) == len(tuned.gains) + 1 and len(gains.rows) == len(tuned.gains) and len(beside.rows) == 2
    assert set(tuned.scenarios()) == {"best", *(f"front-{k + 1}" for k in range(len(tuned.gains)))}


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"gains": {}}, "gains"),
        ({"gains": {"scheme.surface.k9": {"between": [0, 1]}}}, "k9"),
        ({"gains": {"scheme.surface.k1": {"between": [-1, 1]}}}, "k1"),
        ({"gains": {"disturbance.scale": {"between": [0, 1]}}}, "uncertain and varied at once"),
        ({"aims": ["speed"]}, "there is no metric `speed`"),
        ({"candidates": 0}, "candidates"),
        ({"cases": 0}, "cases"),
        ({"holds": ["fast"]}, "holds"),
    ],
)
def test_what_cannot_be_tuned_is_said_in_a_line(said, message):
    with pytest.raises(DefinitionError) as error:
        found("tune", **{**HOW, "candidates": 8, **said})
    assert message in str(error.value) and "\n" not in str(error.value)
