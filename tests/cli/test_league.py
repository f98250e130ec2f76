"""`slidax benchmark` from the command line: kept results and refused requests."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .commands import in_process, own_process


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--tasks", "scara-slwo"), "scara-slow"),
        (("--schemes", "cftsmpc"), "cftsmppc"),
        (("--scheme", "no.such.module:Law"), "cannot import"),
        (("--form", "sampled"), "sampled-data"),
    ],
)
def test_an_unknown_name_is_one_line_and_exit_code_2(arguments: tuple[str, ...], said: str, tmp_path: Path) -> None:
    result = in_process("benchmark", *arguments, "--out", str(tmp_path / "out"))
    assert result.exit_code == 2 and said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1 and not (tmp_path / "out").exists()


@pytest.mark.full
def test_a_small_benchmark_runs_in_processes_and_resumes(tmp_path: Path) -> None:
    asked = ("benchmark", "--small", "--tasks", "scara-slow", "--schemes", "pid,gravity_pd", "--out", str(tmp_path))
    first = own_process(*asked, "--json", "--processes", "2")
    assert first.returncode == 0, first.stderr
    (table,) = json.loads(first.stdout)["tasks"].values()
    assert {(one["scheme"], one["form"]) for one in table["schemes"]} == {
        (scheme, form) for scheme in ("pid", "gravity_pd") for form in ("printed", "sampled-data")
    }
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("runs/*/*.json")}
    assert len(kept) == 4 and own_process(*asked).returncode == 0
    assert kept == {path: path.stat().st_mtime_ns for path in kept}
