import io
import os
import subprocess
import sys

import pytest
from rich.console import Console

from slidax.cli.terminal_plot import funnel
from slidax.scenarios import load

from .commands import in_process


def test_the_demo_shows_three_laws_and_writes_a_page(tmp_path):
    shown = in_process("demo", "--out", str(tmp_path), code=0)
    rows = {line[:20].strip(): line[20:].split() for line in shown.stdout.splitlines() if " of 10001" in line}
    assert rows["CFTSMPPC"][:3] == ["0", "of", "10001"] and int(rows["computed torque + PD"][0]) > 1000
    assert "infinite at 4." in shown.stdout
    assert "steady error [rad]" in shown.stdout, "a unit in brackets is no markup of rich"
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "computed torque + PD" in page and "nan" not in shown.stdout.lower()


def test_the_package_runs_as_a_module_and_on_an_ascii_terminal():
    printed = subprocess.run(
        [sys.executable, "-m", "slidax", "list", "schemes"],
        env=os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
    )
    assert b"cftsmppc" in printed.stdout and not printed.stderr


@pytest.mark.parametrize(("encoding", "marks"), [("utf-8", "\u2800\u2824"), ("ascii", "*")])
def test_terminal_plot_shows_error_and_bounds_in_the_encoding_of_the_terminal(encoding, marks):
    run = load("example-4.1", {"simulation.t1": 0.1, "simulation.log_every": 1}).simulate(progress=False)
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(file=file, width=80)
    console.print(funnel(console, run, run, 1.0))
    file.seek(0)
    text = file.read()
    assert len(text.splitlines()) == 7 and "+0.8" in text and "-0.6" in text
    assert all(mark in text for mark in marks)


def test_reproduce_prints_the_number_of_verdicts_of_each_kind(monkeypatch, tmp_path):
    counts = {"stated": {"reproduced": 10, "close": 0, "differs": 28, "unchecked": 7}}
    results = {"counts": counts, "readings": {"stated": "disturbance as stated"}}
    monkeypatch.setattr("slidax.paper.reproduce", lambda out, disturbance, progress: results)
    shown = in_process("reproduce", "--out", str(tmp_path)).stdout
    assert "disturbance as stated: 10 reproduced, 0 close, 28 differ, 7 unchecked." in " ".join(shown.split())
