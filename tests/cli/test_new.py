"""`slidax new` writes a scenario, says what it assumed, and never writes over one."""

from __future__ import annotations

from pathlib import Path

from slidax import scenarios

from .commands import in_process


def test_a_ready_robot_becomes_a_file_that_is_valid(tmp_path: Path) -> None:
    out = tmp_path / "mine.yaml"
    done = in_process("new", "--robot", "panda", "--rate", "500", "--out", str(out))
    assert done.exit_code == 0, done.output
    assert scenarios.load(out).period == 0.002
    again = in_process("new", "--robot", "panda", "--out", str(out))
    assert again.exit_code == 2
    assert "exists already" in again.output


def test_without_a_file_it_is_printed_and_a_wrong_name_is_one_line() -> None:
    assert in_process("new", "--robot", "panda").output.startswith("title: panda")
    done = in_process("new", "--robot", "pnada")
    assert done.exit_code == 2
    assert "did you mean `panda`" in done.output
