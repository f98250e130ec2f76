"""One declaration of a parameter defines docstring, checks, files, lists and exported C."""

from __future__ import annotations

import re
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from slidax.core import AbstractPart, PerJoint, Scalar, Vector, kind_of, parameter, parameters_of, piece
from slidax.core.errors import DefinitionError
from slidax.core.types import Matrix
from slidax.export.c_structures import members
from slidax.law import AbstractSurface
from slidax.scenarios.catalogue import BLOCKS, KINDS, _rows, explain_parameters
from slidax.scenarios.catalogue import members as described
from slidax.scenarios.descriptions import description_of


def scratch(meaning: str, unit: str, range: str, default: float, source: str) -> type[AbstractSurface]:
    """A surface whose only gain has this declaration."""

    class Scratch(AbstractSurface):
        """`g e`, for this test."""

        gain: PerJoint = parameter(meaning, unit, range, "(eq. 99)", default=default, source=source)

        def phi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
            return self.gain * eps, self.gain * jnp.ones_like(eps)

        def reach(self, phi: Vector) -> Vector:
            return phi / self.gain

    return Scratch


DECLARATIONS = [
    ("g, slope at zero", "1/s", "> 0", 2.0, "Table 9", -1.0),
    ("g, another gain", "1/min", ">= 3", 5.0, "a guess", 2.0),
]


@pytest.mark.parametrize(("meaning", "unit", "range", "default", "source", "wrong"), DECLARATIONS)
def test_a_parameter_declaration_defines_its_documentation_checks_and_messages(
    meaning: str, unit: str, range: str, default: float, source: str, wrong: float
) -> None:
    part = scratch(meaning, unit, range, default, source)
    assert f"- `gain`: {meaning}, one number or [n], {unit}, {range}; {default:g} if not given." in part.__doc__
    message = f"`Scratch.gain` must be {range} {unit} (eq. 99); got {wrong:g}"
    with pytest.raises(DefinitionError, match=re.escape(message)):
        part(wrong)
    (row,) = _rows(description_of(part), "")
    numbers = {"unit": unit, "range": f"{range} (eq. 99)", "default": default, "required": False}
    assert row == {"path": "gain", "source": source, "meaning": meaning, **numbers}
    field = description_of(part).model_json_schema()["properties"]["gain"]
    end = {"> 0": ("exclusiveMinimum", 0.0), ">= 3": ("minimum", 3.0)}[range]
    assert field["description"] == f"{meaning} [{unit}], {range} (eq. 99)."
    assert (field["default"], field["unit"], field["source"], field[end[0]]) == (default, unit, source, end[1])
    (member,) = members(part(), values=True)
    assert member.meaning.startswith(f"{meaning}, {unit}, {range}")
    assert float(member.values) == default
    assert kind_of(part) == "scratch"


@pytest.mark.parametrize(
    ("range", "inside", "outside"),
    [
        ("> 0", [1e-300], [0.0, -1.0, np.inf, np.nan]),
        (">= 0", [0.0], [-1e-300, np.nan]),
        ("(0, 1)", [0.5], [0.0, 1.0]),
        ("[0, 1]", [0.0, 1.0], [1.0000001, -0.1]),
        ("(0, 1]", [1.0], [0.0]),
        ("(1/2, 1)", [0.51], [0.5]),
        ("(0, inf]", [np.inf, 1.0], [0.0, np.nan]),
        ("< 2", [1.0], [2.0]),
        ("", [1e300, -1.0], [np.inf, np.nan]),
    ],
)
def test_a_parameter_accepts_values_inside_its_declared_range_only(
    range: str, inside: list[float], outside: list[float]
) -> None:
    class One(AbstractPart):
        """One number."""

        value: Scalar = parameter("a number", "", range)

    for value in inside:
        assert float(One(value).value) == value
    for value in outside:
        with pytest.raises(DefinitionError, match=r"`One.value` must be"):
            One(value)


def test_a_range_may_depend_on_another_parameter_and_shapes_are_checked() -> None:
    class Pair(AbstractPart):
        """Two numbers."""

        low: PerJoint = parameter("the lower")
        high: PerJoint = parameter("the higher", "m", "> low", "so that there is room")

    assert Pair(1.0, [2.0, 3.0]).high.shape == (2,)
    with pytest.raises(DefinitionError, match=r"must be > `low` = 2.0 m, so that there is room; got 1 for joint 1"):
        Pair(2.0, [1.0, 3.0])
    with pytest.raises(DefinitionError, match="3 entries, but `low` has 2"):
        Pair([1.0, 2.0], [3.0, 3.0, 3.0])
    with pytest.raises(DefinitionError, match="one number or one per joint"):
        Pair([[1.0]], 2.0)


def every_description() -> list[Any]:
    """Each description of scenario files that has parameters."""
    named = {f"{kind}.{name}": model for kind in KINDS for name, model in described(kind).items()} | BLOCKS
    return [pytest.param(model, id=name) for name, model in named.items() if _rows(model, "")]


@pytest.mark.parametrize("model", every_description())
def test_every_parameter_of_scenario_files_has_a_description(model: Any) -> None:
    for row in _rows(model, ""):
        assert len(row["meaning"]) > 3, row["path"]


@pytest.mark.parametrize("kind", ["surfaces", "reaching", "bounds", "performance", "transformations"])
def test_every_parameter_of_a_law_part_declares_a_meaning_and_a_range_or_unit(kind: str) -> None:
    entries = [(model, entry) for model in described(kind).values() for entry in parameters_of(model.part)]
    assert entries
    for model, entry in entries:
        assert entry.meaning, (model.part, entry.name)
        known = entry.piece or entry.range.text or entry.why or entry.unit or not entry.shape
        assert known, (model.part, entry.name)


def test_the_cftsmppc_preset_names_the_source_of_its_default_values() -> None:
    rows = {row["path"]: row for row in explain_parameters("cftsmppc")["parameters"]}
    assert rows["surface.k1"]["default"] == 0.2
    assert rows["surface.k1"]["source"] == "Table 1"
    assert "(eq. 40)" in rows["surface.k1"]["range"]
    assert rows["transformation.overshoot"]["required"]


def test_an_ambiguous_part_name_is_refused_with_the_unambiguous_names() -> None:
    with pytest.raises(
        DefinitionError, match=r"ambiguous name `fixed_time`: use `performance.fixed_time` or `reaching.fixed_time`"
    ):
        explain_parameters("fixed_time")
    assert explain_parameters("reaching.fixed_time")["parameters"][0]["path"] == "gain"
    with pytest.raises(DefinitionError, match="did you mean `computed_torque`"):
        explain_parameters("computd_torque")


def test_fields_declared_as_piece_are_documented_but_not_checked() -> None:
    class Holder(AbstractPart):
        """Something."""

        surface: AbstractSurface = piece("what it holds")

    assert "- `surface`: what it holds." in (Holder.__doc__ or "")
    assert "Raises" not in (Holder.__doc__ or "")
    assert Holder("anything").surface == "anything"


def test_annotations_that_are_types_instead_of_strings_give_the_same_shapes():
    """As in a module without `from __future__ import annotations`."""
    fields = {"a": PerJoint, "b": Scalar, "c": Vector | None, "d": Float[Array, "3"], "e": Matrix}
    body = {name: parameter("meaning", default=None) for name in fields}
    kind = type("Written", (AbstractPart,), {"__annotations__": fields, "__module__": __name__, **body})
    shapes = {each.name: each.shape for each in parameters_of(kind)}
    assert shapes == {"a": "one number or [n]", "b": "one number", "c": "[n]", "d": "[3]", "e": "[n n]"}
