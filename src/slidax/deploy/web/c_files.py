"""The law in C beside a page: the files of `slidax export c`, with places for what the page has changed."""

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
"""What a program needs; not the tests, whose samples are large."""


def c_files(family: Family, templates: Templates, tunables: Sequence[Tunable]) -> dict[str, Any]:
    """The entries `c_files` and `c_parameters` of a setting; both None where there is no C of the law.

    - `family`, `templates`: the scenario.
    - `tunables`: of the page.
    """
    try:
        made = project(templates.built, name="law", with_golden=False)
    except DefinitionError:
        return {"c_files": None, "c_parameters": None}
    files = {FILES[name].format(prefix=made.prefix, name=made.name): render(name, {"x": made}) for name in TEMPLATES}
    source, header = f"{made.prefix}.c", f"{made.prefix}.h"
    values = []
    for tunable in tunables:
        name = _member(tunable.path)
        # Many numbers stand in several lines.
        found = name and re.search(rf"^( +\.{name} = )({{[^{{}}]*}}|[^{{}},\n]+),$", files[source], re.MULTILINE)
        if not name or not found or not _alone(family, templates, tunable):
            continue
        marks = [f"@{{{name}[{k}]}}" for k in range(found.group(2).count(",") + 1)]
        text = marks[0] if not found.group(2).startswith("{") else "{" + ", ".join(marks) + "}"
        files[source] = files[source].replace(found.group(0), f"{found.group(1)}{text},")
        files[header] = _without_default(files[header], name, f"as {made.prefix}_parameters_default says")
        values.append({"path": tunable.path, "marks": marks})
    whole = packed(json.dumps(files).encode())
    return {"c_files": whole, "c_parameters": {"file": source, "values": values}}


def _member(path: str) -> str | None:
    """What the number is called in C; None for what the law is not told."""
    block, _, rest = path.partition(".")
    if path == "actuator.rate" or path == "actuator.torque":
        return f"limits_{rest}"
    return rest.removeprefix("sampled_data.").replace(".", "_") if block == "scheme" else None


def _without_default(header: str, name: str, words: str) -> str:
    """The header with words in place of a default, which may be another now."""
    return re.sub(
        rf"(\b{name}(?:\[\w+\])?; +/\* )[^:*]*?(?=:| \*/)", lambda found: f"{found[1]}{words}", header, count=1
    )


def _alone(family: Family, templates: Templates, tunable: Tunable) -> bool:
    """Whether just one array of the law depends on a number, so that to set it there is to set it."""
    asked = Family(family.base, Space({}, {}), Space({}, {tunable.path: None}))  # type: ignore[dict-item]
    moved: list[bool] = []

    def probe(value: Array) -> int:
        with jax.ensure_compile_time_eval():
            controller = asked.parts(templates, {tunable.path: value})[1]
        moved[:] = [is_traced(leaf) for leaf in jax.tree.leaves(eqx.filter(controller, eqx.is_array))]
        return 0

    try:
        jax.eval_shape(probe, jax.ShapeDtypeStruct(np.shape(tunable.defaults), float))
    except UNTRACEABLE:
        return False
    return sum(moved) == 1
