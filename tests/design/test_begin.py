"""What a design begins with."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from slidax.design import read_problem

from .test_requirements import EXAMPLES

design = sys.modules["slidax.design.design"]


@pytest.mark.parametrize(
    ("file", "proof", "learns"),
    [("two-link", "bound", True), ("panda-light", "bound", False), ("panda-light", "tested", True)],
)
def test_a_law_of_many_joints_for_which_a_bound_is_asked_does_not_learn(
    file: str, proof: str, learns: bool, tmp_path: Path
) -> None:
    data = YAML(typ="safe").load((EXAMPLES / f"{file}.yaml").read_text(encoding="utf-8"))
    data["requirements"]["proof"] = proof
    path = tmp_path / "requirements.yaml"
    with path.open("w", encoding="utf-8") as written:
        YAML(typ="safe").dump(data, written)
    problem = read_problem(path)
    frame, choice = design._begin(problem)
    assert frame.learns is learns
    scenario: Any = frame.described(choice).build("begun")
    assert (scenario.controller.adaptation is not None) is learns
