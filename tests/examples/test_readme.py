"""What README and overview show is what happens."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
import pytest

from tests.cli.commands import in_process

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
OVERVIEW = (ROOT / "docs" / "overview.md").read_text(encoding="utf-8")


def test_the_python_example_is_ten_lines_and_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", OVERVIEW, re.DOTALL)
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    mpl.use("agg")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "overview.md", "exec"), {})
    assert (tmp_path / "tracking_error.svg").stat().st_size > 1000


def test_the_table_in_the_overview_is_the_one_that_the_command_prints() -> None:
    shown = OVERVIEW.split("$ slidax run example-4.1\n")[1].split("```")[0]
    printed = in_process("run", "example-4.1").stdout
    for line in shown.strip().splitlines():
        assert line.rstrip() in printed, line


def test_every_file_that_the_readme_links_to_is_there() -> None:
    for link in re.findall(r"\]\((?!http)([^)]+)\)", README):
        assert (ROOT / link).exists(), link


def test_the_moving_picture_is_small_and_asks_nothing_of_others() -> None:
    text = (ROOT / "docs" / "figures" / "panda-moving.svg").read_text(encoding="utf-8")
    assert len(text) < 2_000_000
    assert "<animate" in text and "prefers-color-scheme: dark" in text and "<title" in text
    assert not re.findall(r"<script|https?://(?!www\.w3\.org/2000/svg)", text)


def test_every_command_that_is_shown_is_one() -> None:
    commands = {tuple(line.split()[:1]) for line in re.findall(r"\$ slidax (.*)", README + OVERVIEW)}
    known = in_process("--help").stdout
    for (name,) in commands:
        assert f" {name} " in known, name
