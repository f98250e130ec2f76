"""Schemes are compared case by case, on the same cases."""

import json

import numpy as np
import pytest

from slidax.core.errors import DefinitionError

from .kinds import UNCERTAIN, found

pytest.importorskip("llvmlite")

SCHEMES = {
    "ours": {},
    "the_same": {"scheme.surface.k1": 0.2},
    "slower": {"scheme.surface.k1": 0.02, "scheme.surface.k2": 0.05},
    "computed_torque": {"scheme.name": "computed_torque"},
}


@pytest.fixture(scope="module")
def compared():
    inside = {**UNCERTAIN, "start": {"inside": "envelope", "share": 0.5}}
    del inside["start.q"]
    return found("compare", schemes=SCHEMES, runs=24, uncertainty=inside)


@pytest.mark.full
def test_all_schemes_have_the_same_cases_also_where_they_depend_on_the_envelope_of_the_first(compared):
    tables = list(compared.tables.values())
    for name in ("robot.plant.masses[0]", "start.q[0]", "start.q[1]", "disturbance.scale"):
        for table in tables[1:]:
            np.testing.assert_array_equal(tables[0][name], table[name])
    assert np.ptp(tables[0]["start.q[0]"]) > 0.1


def test_a_scheme_does_not_differ_from_itself(compared):
    same = compared.difference("the_same", "steady_error")
    assert (same.mean, same.p_value, same.significant) == (0.0, 1.0, False)
    assert compared.shares("the_same", "envelope").difference == 0.0


def test_a_slower_scheme_is_found_to_be_worse_case_by_case(compared):
    slower = compared.difference("slower", "steady_error")
    assert slower.pairs == 24 and slower.of_mean.lower > 0.0
    ours, theirs = (compared.tables[name]["steady_error"] for name in ("slower", "ours"))
    assert slower.mean == pytest.approx(np.mean(ours - theirs))
    assert "slower is better in peak_torque and worse in steady_error" in compared.lead


def test_a_scheme_without_an_envelope_is_compared_in_the_rest(compared):
    assert compared.rate("computed_torque", "envelope") == (None, None)
    assert compared.shares("computed_torque", "envelope") is None
    assert compared.difference("computed_torque", "peak_torque").pairs == 24


def test_its_page_and_its_answer_hold_all_of_it(compared):
    text = compared.as_json()
    assert text["reference"] == "ours" and list(text["schemes"]) == list(SCHEMES)
    assert text["schemes"]["slower"]["differences"]["steady_error"]["interval"]["lower"] > 0.0
    json.dumps(text, allow_nan=False)
    rates, differences = compared.sections()
    assert len(rates.rows) == 4 and len(differences.rows) == 3 * 3
    assert all(len(row) == len(section.head) for section in (rates, differences) for row in section.rows)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"schemes": {"ours": {}}}, "schemes"),
        ({"schemes": {"ours": {}, "../x": {}}}, "must be letters"),
        ({"schemes": {"ours": {}, "b": {"scheme.nam": "ftsmc"}}}, "schemes.b"),
        ({"of": ["steady"]}, "there is no metric `steady`"),
        ({"holds": ["envelop"]}, "holds"),
        ({"uncertainty": {}}, "uncertainty: is empty"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_line(said, message):
    with pytest.raises(DefinitionError) as error:
        found("compare", **{"runs": 2, "schemes": {"ours": {}, "the_same": {}}, **said})
    assert message in str(error.value) and "\n" not in str(error.value)
