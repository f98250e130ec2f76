"""`slidax demo` and `python -m slidax`."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from slidax.cli.terminal_plot import funnel
from slidax.scenarios import load

from .commands import in_process


def test_the_demo_shows_three_laws_and_writes_a_page(tmp_path: Path) -> None:
    shown = in_process("demo", "--out", str(tmp_path))
    assert shown.exit_code == 0, shown.output
    rows = {line[:20].strip(): line[20:].split() for line in shown.stdout.splitlines() if " of 10001" in line}
    assert rows["CFTSMPPC"][:3] == ["0", "of", "10001"]
    assert int(rows["computed torque + PD"][0]) > 1000
    assert "not finite at 4." in shown.stdout
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "computed torque + PD" in page and "nan" not in shown.stdout.lower()


def test_a_place_that_cannot_be_written_is_said_at_once(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    refused = in_process("demo", "--out", str(tmp_path / "taken"))
    assert refused.exit_code == 2
    assert "taken" in refused.output


def test_the_package_runs_as_a_module_and_on_a_terminal_of_few_letters() -> None:
    told = subprocess.run(
        [sys.executable, "-m", "slidax", "list", "schemes"],
        env=os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
    )
    assert b"cftsmppc" in told.stdout and not told.stderr


@pytest.mark.parametrize(("encoding", "marks"), [("utf-8", "\u2800\u2824"), ("ascii", "*")])
def test_terminal_plot_shows_error_and_bounds_in_the_encoding_of_the_terminal(encoding: str, marks: str) -> None:
    run = load("example-4.1", {"simulation.t1": 0.1, "simulation.log_every": 1}).simulate(progress=False)
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(file=file, width=80)
    console.print(funnel(console, run, run, 1.0))
    file.seek(0)
    text = file.read()
    assert len(text.splitlines()) == 7 and "+0.8" in text and "-0.6" in text
    assert all(mark in text for mark in marks)
