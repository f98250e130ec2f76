"""The law of an arm with seven joints as C: its nominal arm is in it."""

from __future__ import annotations

import pytest

from slidax.export.c_project import FILES, project
from slidax.export.c_structures import render
from slidax.scenarios import load

from .agreement import NO_LIMITS, Pair, agree, named
from .exported import COMPILERS, compiled, needs_a_compiler

pytestmark = needs_a_compiler

PARTS = ("header.h.j2", "step.c.j2", "scenario.h.j2", "scenario.c.j2")


@pytest.mark.full
def test_the_law_of_a_panda_and_the_panda_itself_are_c_without_a_warning(tmp_path):
    made = project(load("panda-payload"), name="law", with_golden=False)
    for template in PARTS:
        (tmp_path / FILES[template].format(prefix=made.prefix)).write_text(render(template, {"x": made}))
    sources = [FILES[template].format(prefix=made.prefix) for template in PARTS if template.endswith(".c.j2")]
    compiled(COMPILERS[0], tmp_path, "-O1", "-fsyntax-only", *sources)
    header = (tmp_path / f"{made.prefix}.h").read_text()
    # What is known of the arm can be changed between two steps, its gripper, too.
    for member in ("nominal_masses[7]", "nominal_inertias[63]", "nominal_armature[7]", "nominal_payload_mass;"):
        assert member in header, member
    # As it is printed for the second link, and not as it comes out of a sum.
    assert " -0.02872," in header


PAIRS: list[Pair] = [("panda-payload", "cftsmppc", NO_LIMITS), ("panda-payload", "cftsmppc", {})]


@pytest.mark.full
@pytest.mark.parametrize("pair", PAIRS, ids=named)
def test_the_torque_of_c_is_that_of_python(pair, tmp_path):
    agree(pair, tmp_path)
