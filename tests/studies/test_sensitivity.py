"""Shares of the variance go to what the result depends on."""

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.studies.sensitivity import sobol_indices

from .kinds import found

pytest.importorskip("SALib")
pytest.importorskip("llvmlite")


@pytest.fixture(scope="module")
def shares():
    return found("sensitivity", base=64, of=["margin", "peak_torque"])


@pytest.mark.full
def test_the_margin_at_the_beginning_depends_on_the_start_alone(shares):
    assert shares.runs == 64 * (4 + 2)
    assert shares.names == ("robot.plant.masses", "robot.plant.inertias", "disturbance.scale", "start.q")
    margin = shares.indices["margin"]
    assert margin.total[3] > 0.8 and margin.total[:3].max() < 0.05
    assert "`margin` start.q" in shares.lead


def test_the_indices_are_those_of_its_rows(shares):
    again = sobol_indices(shares.table["peak_torque"], [1, 2, 1, 2])
    np.testing.assert_array_equal(again.total, shares.indices["peak_torque"].total)
    rows = shares.as_json()["indices"]["peak_torque"]
    assert [row["total"] for row in rows] == again.total.tolist()


def test_each_number_can_have_its_own_share():
    each = found("sensitivity", base=8, of=["peak_torque"], each="number")
    assert each.names[1:3] == ("robot.plant.inertias[0]", "robot.plant.inertias[1]")
    assert each.runs == 8 * (6 + 2)


def test_its_page_has_a_table_and_a_picture_for_each_result(shares):
    assert [section.title for section in shares.sections()] == ["Dependence of margin", "Dependence of peak_torque"]
    assert [picture.name for section in shares.sections() for picture in section.figures] == [
        "shares-margin",
        "shares-peak_torque",
    ]


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"base": 100}, "base: must be a power of two"),
        ({"of": ["peak_torqe"]}, "did you mean `peak_torque`"),
        ({"of": []}, "of"),
        ({"uncertainty": {}}, "uncertainty: is empty"),
        ({"each": "joint"}, "each"),
    ],
)
def test_what_cannot_be_shared_out_is_said_in_a_line(said, message):
    with pytest.raises(DefinitionError) as error:
        found("sensitivity", **{"base": 2, **said})
    assert message in str(error.value) and "\n" not in str(error.value)
