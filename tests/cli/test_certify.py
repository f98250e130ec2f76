"""`slidax certify`: table, JSON, page and exit codes."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import pytest

from slidax.certify import admissibility
from slidax.certify.printed import settling_time, ultimate_bound

from .commands import in_process

KEYS = {"name", "holds", "grade", "since", "margin", "bound", "assumptions", "statement", "remedy"}


def only(monkeypatch: pytest.MonkeyPatch, *certificates: Any) -> None:
    """The others have tests of their own, and take longer."""
    monkeypatch.setattr(importlib.import_module("slidax.certify.certify"), "CERTIFICATES", certificates)


def test_json_and_page_agree_and_exit_code_is_4_if_a_certificate_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch, admissibility, settling_time, ultimate_bound)
    words = ["certify", "example-4.2", "--runs", "0", "--set", "simulation.t1=8"]
    done = in_process(*words, "--json", "--out", str(tmp_path))
    assert done.exit_code == 4, done.output
    answer = json.loads(done.stdout)
    assert answer == json.loads((tmp_path / "certificate.json").read_text(encoding="utf-8"))
    assert list(answer) == ["certificates"]
    found = {one["name"]: one for one in answer["certificates"]}
    assert {"admissibility", "settling_time", "ultimate_bound"} <= found.keys()
    for one in found.values():
        assert one.keys() == KEYS
        assert all(said.keys() == {"text", "status", "value"} for said in one["assumptions"])
        assert {said["status"] for said in one["assumptions"]} <= {"proved", "tested", "assumed", "fails"}
        assert all(said.keys() == {"words", "set"} for said in one["remedy"])
    assert (found["admissibility"]["holds"], found["settling_time"]["holds"]) == (True, False)
    assert found["ultimate_bound"]["holds"] and len(found["ultimate_bound"]["bound"]["error"]) == 3
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert found["ultimate_bound"]["name"] in page.replace("_\u200b", "_") and "These certificates do not hold" in page
    assert (tmp_path / "figures" / "bounded-error.svg").exists()


def test_exit_code_is_0_if_all_certificates_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, admissibility)
    words = ["certify", "example-4.1", "--runs", "0", "--set", "simulation.t1=0.1"]
    done = in_process(*words)
    assert done.exit_code == 0, done.output
    assert "Guarantee" in done.stdout and "proved  the start is inside" in done.stdout
    outside = in_process(*words, "--set", "start.q=[-1, 2.5]")
    assert outside.exit_code == 4 and "joint 1 begins" in outside.stdout
    assert "--set 'scheme.transformation.performance.initial=[1.5,0.6]'" in outside.stdout


def test_invalid_scenario_has_exit_code_2_and_help_has_an_example() -> None:
    bad = in_process("certify", "example-4.2", "--set", "scheme.surface.p=1")
    assert bad.exit_code == 2 and "eq. 29" in bad.stderr and not bad.stdout
    assert in_process("certify", "nothing").exit_code == 2
    told = in_process("certify", "--help").stdout
    assert "Example:" in told and "slidax certify example-4.2" in told
