"""`slidax export franka`, `ur` and `ros2` as a user types them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.commands import in_process

WITHOUT = ("--set", "scheme={name: computed_torque}", "--set", "simulation.t1=0.5")
"""A law that exports fast, and a short run for its golden samples."""


@pytest.mark.full
def test_ros2_writes_its_package_and_says_where_it_is(tmp_path: Path) -> None:
    out = tmp_path / "package"
    done = in_process("export", "ros2", "example-4.1-1khz", "--out", str(out), "--name", "arm", *WITHOUT)
    assert done.exit_code == 0, done.output
    assert str(out / "README.md") in done.output
    assert (out / "src" / "parameters.yaml").is_file() and (out / "law" / "golden.h").is_file()
    # What is written runs without this package.
    assert "slidax" not in "".join(
        line for line in (out / "node.py").read_text().splitlines() if line.startswith(("import", "from"))
    )


@pytest.mark.parametrize(
    ("target", "scenario", "more", "word"),
    [
        ("franka", "example-4.1-1khz", (), "7 joints"),
        ("franka", "panda-payload", ("--set", "simulation.period=2e-3"), "simulation.period"),
        ("ur", "example-4.1-1khz", (), "6 joints"),
        ("ros2", "example-4.1-1khz", ("--gravity", "robot"), "articulated"),
        ("ros2", "example-9", (), "unknown scenario"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    tmp_path: Path, target: str, scenario: str, more: tuple[str, ...], word: str
) -> None:
    fast = ("--set", "scheme={name: computed_torque}")
    done = in_process("export", target, scenario, "--out", str(tmp_path), *fast, *more)
    assert done.exit_code == 2, done.output
    assert word in done.output and len(done.output.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
