import re
from functools import cache

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
def offered(name):
    base = load(name).description
    base = base.model_copy(update={"robot": base.robot.resolved()})
    family = Family(base, Space({}, {}), Space({}, {}))
    templates = family.templates({})
    tunables = tunables_of(base, templates.built.plant.robot.joints)
    result = c_files(family, templates, tunables)
    return (
        base,
        unpacked(result["c_files"]),
        result["c_parameters"],
        {tunable.path: tunable.defaults for tunable in tunables},
    )


def filled(name, moved):
    _, files, where, own = offered(name)
    texts = dict(files)
    for item in where["values"]:
        value = np.asarray(moved.get(item["path"], own[item["path"]]))
        value = value if value.shape == (len(item["marks"]),) else np.unique(value)
        numbers = np.broadcast_to(value, len(item["marks"]))
        for mark, number in zip(item["marks"], numbers, strict=True):
            texts[where["file"]] = texts[where["file"]].replace(mark, repr(float(number)))
    assert "@{" not in texts[where["file"]]
    return texts


def exported(name, changes):
    data = offered(name)[0].model_dump(exclude_unset=True)
    texts = project(validate_text(data, dict(changes)).build("law"), name="law", with_golden=False)
    names = {"header.h.j2": "slidax_law.h", "step.c.j2": "slidax_law.c"}
    return {file: render(template, {"x": texts}) for template, file in names.items()}


def assert_same_text(ours, theirs):
    assert NUMBER.sub("#", ours) == NUMBER.sub("#", theirs)
    a, b = ([float(item) for item in NUMBER.findall(text)] for text in (ours, theirs))
    np.testing.assert_array_equal(a, b)


def moved_by(name, factor):
    base, _, where, own = offered(name)
    data = base.model_dump(exclude_unset=True)
    result = {}
    for item in where["values"]:
        path = item["path"]
        number = own[path] * factor if np.any(own[path]) else np.full_like(own[path], 0.01)
        value = number.tolist() if len(item["marks"]) > 1 else float(np.ravel(number)[0])
        try:
            validate_text(data, {**result, path: value})
        except ValueError:
            continue
        result[path] = value
    return result


@pytest.mark.parametrize(
    ("name", "marks"),
    [
        ("example-4.1", 10),
        pytest.param("example-4.1-1khz", 20, marks=pytest.mark.full),
        pytest.param("panda-payload", 20, marks=pytest.mark.full),
    ],
)
def test_c_files_with_changed_values_equal_the_export_of_the_changed_scenario(name, marks):
    moved = moved_by(name, 1.07)
    assert len(moved) > marks
    ours, theirs = filled(name, moved), exported(name, moved)
    assert_same_text(ours["slidax_law.c"], theirs["slidax_law.c"])
    # Comments of the header state no default, which may have changed.
    header = [line for line in ours["slidax_law.h"].split("\n") if "parameters_default says" in line]
    assert len(header) == len(offered(name)[2]["values"])
    assert len(ours["slidax_law.h"].split("\n")) == len(theirs["slidax_law.h"].split("\n"))


def test_only_parameters_of_the_law_can_change_in_the_c_files():
    _, files, where, _ = offered("example-4.1")
    paths = {item["path"] for item in where["values"]}
    assert "scheme.surface.k1" in paths and all(path.startswith(("scheme.", "actuator.")) for path in paths)
    assert set(files) >= {"slidax_law.h", "slidax_law.c", "example.c"} and len(TEMPLATES) == len(files)
