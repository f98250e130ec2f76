"""Every script in examples/ runs, and is short."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parents[2] / "examples").glob("[0-9]*.py"))
EVERY = pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)

# One process imports the package once for all of them.
TOGETHER = """
import contextlib, io, json, runpy, sys
said = {}
for script in sys.argv[1:]:
    sys.argv = [script]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        runpy.run_path(script, run_name="__main__")
    said[script] = out.getvalue()
print(json.dumps(said))
"""


def output(folder: Path, *arguments: str) -> str:
    """What Python prints, with warnings as errors."""
    result = subprocess.run(
        [sys.executable, "-W", "error", *arguments],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def assert_says_something(said: str) -> None:
    assert said.strip()
    assert "nan" not in said


def test_the_examples_run_one_after_the_other_and_each_says_something(tmp_path: Path) -> None:
    said = json.loads(output(tmp_path, "-c", TOGETHER, *map(str, SCRIPTS)))
    assert len(said) == len(SCRIPTS)
    for text in said.values():
        assert_says_something(text)


@pytest.mark.full
@EVERY
def test_an_example_runs_by_itself(script: Path, tmp_path: Path) -> None:
    assert_says_something(output(tmp_path, str(script)))


@EVERY
def test_64_bit_numbers_are_switched_on_before_anything_else(script: Path) -> None:
    """Run one after the other, the first would do it for all."""
    before = script.read_text(encoding="utf-8").split('jax.config.update("jax_enable_x64", True)')[0]
    assert "slidax as" not in before and "jax.numpy" not in before
    assert before != script.read_text(encoding="utf-8")


@EVERY
def test_an_example_is_under_60_lines(script: Path) -> None:
    assert len(script.read_text(encoding="utf-8").splitlines()) < 60
