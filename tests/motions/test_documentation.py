"""Code and messages in docs/trajectories.md work as shown."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from slidax.motions import Tabulated
from slidax.scenarios.trajectories import TrajectoryDescription

PAGE = (Path(__file__).parents[2] / "docs" / "trajectories.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_program_on_the_page_prints_the_output_on_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks("python")[0], "trajectories.md", "exec"), {})
    assert capsys.readouterr().out == blocks("text")[0]


def test_ros_message_on_the_page_is_read() -> None:
    assert float(Tabulated.from_joint_trajectory(blocks("json")[0]).until) == 2.0


def test_every_trajectory_kind_is_on_the_page() -> None:
    kinds = TypeAdapter(TrajectoryDescription).json_schema()["discriminator"]["mapping"]
    assert all(f"| `{kind}` |" in PAGE for kind in kinds)
