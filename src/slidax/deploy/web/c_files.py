"""The law in C for download from a page: files of `slidax export c`, with marks for the values changed on the page."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from slidax._errors import DefinitionError, is_traced
from slidax.deploy.project import FILES, STEP, project
from slidax.deploy.text import render
from slidax.scenarios.family import UNTRACEABLE, Family, Templates
from slidax.scenarios.uncertainty import Space

from .knob import Tunable
from .loop_program import packed

TEMPLATES = (*STEP, "example.c.j2")
"""The files that a program needs; not the tests, whose samples are large."""


def c_files(family: Family, templates: Templates, tunables: Sequence[Tunable]) -> dict[str, Any]:
    """The entries `c_files` and `c_parameters` of a setting; both None if the law cannot be exported."""
    try:
        exported = project(templates.built, name="law", with_golden=False)
    except DefinitionError:
        return {"c_files": None, "c_parameters": None}
    files = {
        FILES[name].format(prefix=exported.prefix, name=exported.name): render(name, {"x": exported})
        for name in TEMPLATES
    }
    source, header = f"{exported.prefix}.c", f"{exported.prefix}.h"
    values = []
    for tunable in tunables:
        name = _member(tunable.path)
        # A long array spans several lines.
        match = name and re.search(rf"^( +\.{name} = )({{[^{{}}]*}}|[^{{}},\n]+),$", files[source], re.MULTILINE)
        if not name or not match or not _alone(family, templates, tunable):
            continue
        marks = [f"@{{{name}[{k}]}}" for k in range(match.group(2).count(",") + 1)]
        text = marks[0] if not match.group(2).startswith("{") else "{" + ", ".join(marks) + "}"
        files[source] = files[source].replace(match.group(0), f"{match.group(1)}{text},")
        files[header] = _without_default(files[header], name, f"as {exported.prefix}_parameters_default says")
        values.append({"path": tunable.path, "marks": marks})
    whole = packed(json.dumps(files).encode())
    return {"c_files": whole, "c_parameters": {"file": source, "values": values}}


def _member(path: str) -> str | None:
    """Name of the value in C; None if it is not a parameter of the law."""
    block, _, rest = path.partition(".")
    if path == "actuator.rate" or path == "actuator.torque":
        return f"limits_{rest}"
    return rest.removeprefix("sampled_data.").replace(".", "_") if block == "scheme" else None


def _without_default(header: str, name: str, words: str) -> str:
    """Replace a member's default in the header, which the page may change, by words."""
    return re.sub(
        rf"(\b{name}(?:\[\w+\])?; +/\* )[^:*]*?(?=:| \*/)", lambda match: f"{match[1]}{words}", header, count=1
    )


def _alone(family: Family, templates: Templates, tunable: Tunable) -> bool:
    """True if exactly one array of the law depends on a tunable, so that setting this array sets the tunable."""
    family_of_one = Family(family.base, Space({}, {}), Space({}, {tunable.path: None}))  # type: ignore[dict-item]
    moved: list[bool] = []

    def probe(value: Array) -> int:
        with jax.ensure_compile_time_eval():
            controller = family_of_one.parts(templates, {tunable.path: value})[1]
        moved[:] = [is_traced(leaf) for leaf in jax.tree.leaves(eqx.filter(controller, eqx.is_array))]
        return 0

    try:
        jax.eval_shape(probe, jax.ShapeDtypeStruct(np.shape(tunable.defaults), float))
    except UNTRACEABLE:
        return False
    return sum(moved) == 1
