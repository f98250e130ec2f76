import pytest

from slidax.export.c_project import project
from slidax.export.fmu_variables import parse_unit, variables
from slidax.export.programs import envelope_function
from slidax.scenarios import load


@pytest.mark.parametrize(
    ("declared", "name", "base"),
    [
        ("kg m²", "kg.m2", {"kg": 1, "m": 2}),
        ("N m s²/rad²", "N.m.s2/rad2", {"kg": 1, "m": 2, "rad": -2}),
        ("1/(kg m²)", "1/(kg.m2)", {"kg": -1, "m": -2}),
        ("N m/A", "N.m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("V s", "V.s", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    ],
)
def test_declared_units_become_fmu_units_with_their_base_units(declared, name, base):
    result = parse_unit(declared)
    assert result.name == name and dict(result.base) == base


@pytest.mark.parametrize(
    ("declared", "revolute", "prismatic"),
    [
        (
            "(rad/s²)² s or (m/s²)² s",
            ("(rad/s2)2.s", {"rad": 2, "s": -3}),
            ("(m/s2)2.s", {"m": 2, "s": -3}),
        ),
        (
            "N m/(rad s) or N/(m s)",
            ("N.m/(rad.s)", {"kg": 1, "m": 2, "s": -3, "rad": -1}),
            ("N/(m.s)", {"kg": 1, "s": -3}),
        ),
    ],
)
def test_a_unit_of_both_kinds_of_joints_follows_the_kind_of_the_joint(declared, revolute, prismatic):
    for kind, expected in ((True, revolute), (False, prismatic)):
        unit = parse_unit(declared, revolute=kind)
        assert (unit.name, dict(unit.base)) == expected
    assert parse_unit(declared, revolute=None) is None


@pytest.mark.parametrize(
    "declared", ["", "periods", "1, 1/s or 1/s²", "rad^(1-κ)/s", "rad^½/s^(3/2) or m^½/s^(3/2)", "furlong/s", "2 m"]
)
def test_declarations_without_an_si_unit_have_no_fmu_unit(declared):
    assert parse_unit(declared) is None


def test_a_law_without_an_envelope_has_no_envelope_variables():
    law = project(
        load("example-4.1", {"simulation.mode": "held", "scheme": {"name": "ftsmc"}}), name="law", with_golden=False
    )
    assert envelope_function(law.guard, law.step) is None
    result = {each.name: each for each in variables(law, with_envelope=False)}
    assert not [name for name in result if name.startswith("envelope")]
    assert result["command.eps1[1]"].unit.name == "rad" and "transformed" not in result["command.eps1[1]"].description
