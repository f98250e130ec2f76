"""The law that a page writes in C: with the sliders' numbers it is the law that `slidax export c` writes of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

from slidax.export.c_project import project
from slidax.export.c_structures import render
from slidax.export.web.settings import TEMPLATES, c_files
from slidax.export.web.tunables import tunables_of
from slidax.scenarios import load
from slidax.scenarios.family import Family, Space
from slidax.scenarios.load import validate_text

from .played import unpacked

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


@cache
def offered(name: str) -> tuple[Any, Mapping[str, str], Mapping[str, Any], Mapping[str, np.ndarray]]:
    """The scenario, the files with their marks, where the marks are, and what the numbers are as given."""
    base = load(name).description
    base = base.model_copy(update={"robot": base.robot.resolved()})
    family = Family(base, Space({}, {}), Space({}, {}))
    templates = family.templates({})
    tunables = tunables_of(base, templates.built.plant.robot.joints)
    found = c_files(family, templates, tunables)
    return (
        base,
        unpacked(found["c_files"]),
        found["c_parameters"],
        {tunable.path: tunable.defaults for tunable in tunables},
    )


def filled(name: str, moved: Mapping[str, Any]) -> dict[str, str]:
    """The files with numbers for the marks, as the page's scenario.js puts them there."""
    _, files, where, given = offered(name)
    made = dict(files)
    for one in where["values"]:
        value = np.asarray(moved.get(one["path"], given[one["path"]]))
        value = value if value.shape == (len(one["marks"]),) else np.unique(value)
        numbers = np.broadcast_to(value, len(one["marks"]))
        for mark, number in zip(one["marks"], numbers, strict=True):
            made[where["file"]] = made[where["file"]].replace(mark, repr(float(number)))
    assert "@{" not in made[where["file"]]
    return made


def exported(name: str, changes: Mapping[str, Any]) -> dict[str, str]:
    """What `slidax export c` writes of the scenario that the page gives to be downloaded."""
    data = offered(name)[0].model_dump(exclude_unset=True)
    made = project(validate_text(data, dict(changes)).build("law"), name="law", with_golden=False)
    names = {"header.h.j2": "slidax_law.h", "step.c.j2": "slidax_law.c"}
    return {file: render(template, {"x": made}) for template, file in names.items()}


def assert_same_text(ours: str, theirs: str) -> None:
    """The same words, and numbers that are the same to the last digit, however they are written."""
    assert NUMBER.sub("#", ours) == NUMBER.sub("#", theirs)
    a, b = ([float(one) for one in NUMBER.findall(text)] for text in (ours, theirs))
    np.testing.assert_array_equal(a, b)


def moved_by(name: str, factor: float) -> dict[str, Any]:
    """All that has a mark, moved as far as it may."""
    base, _, where, given = offered(name)
    data = base.model_dump(exclude_unset=True)
    found: dict[str, Any] = {}
    for one in where["values"]:
        path = one["path"]
        number = given[path] * factor if np.any(given[path]) else np.full_like(given[path], 0.01)
        value = number.tolist() if len(one["marks"]) > 1 else float(np.ravel(number)[0])
        try:
            validate_text(data, {**found, path: value})
        except ValueError:
            continue
        found[path] = value
    return found


@pytest.mark.parametrize(
    ("name", "marks"),
    [
        ("example-4.1", 10),
        pytest.param("example-4.1-1khz", 20, marks=pytest.mark.full),
        pytest.param("panda-payload", 20, marks=pytest.mark.full),
    ],
)
def test_moved_numbers_make_the_file_that_the_moved_scenario_is_exported_to(name: str, marks: int) -> None:
    moved = moved_by(name, 1.07)
    assert len(moved) > marks
    ours, theirs = filled(name, moved), exported(name, moved)
    assert_same_text(ours["slidax_law.c"], theirs["slidax_law.c"])
    # The header's comments name no default that may have been moved.
    header = [line for line in ours["slidax_law.h"].split("\n") if "parameters_default says" in line]
    assert len(header) == len(offered(name)[2]["values"])
    assert len(ours["slidax_law.h"].split("\n")) == len(theirs["slidax_law.h"].split("\n"))


def test_what_the_law_is_not_told_has_no_mark() -> None:
    _, files, where, _ = offered("example-4.1")
    paths = {one["path"] for one in where["values"]}
    assert not {path for path in paths if not path.startswith(("scheme.", "actuator."))}
    assert set(files) >= {"slidax_law.h", "slidax_law.c", "example.c"}
    assert len(TEMPLATES) == len(files)
