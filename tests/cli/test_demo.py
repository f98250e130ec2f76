"""`slidax demo`: what it draws is what was simulated."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slidax.cli.dots import Dots

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


@pytest.mark.parametrize(("plain", "full", "one"), [(False, "\u28ff", "\u2880"), (True, "*", ".")])
def test_a_stroke_fills_its_dots_from_the_bottom(plain: bool, full: str, one: str) -> None:
    field = Dots(3, 2, plain=plain)
    for x in (0, 1):
        field.stroke(x, 0.0, 1.0, "")
    field.stroke(3, 0.0, 0.0, "")
    field.stroke(5, 1.5, 2.0, "")
    field.stroke(4, np.nextafter(1.0, 2.0), 3.0, "")
    assert [line.plain for line in field.lines()] == [full + "  ", full + one + " "]
