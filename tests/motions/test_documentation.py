"""What docs/trajectories.md shows is what happens."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from slidax.arms import JointLimits
from slidax.motions import Tabulated
from slidax.scenarios.trajectories import TrajectoryDescription
from slidax.scenarios.yaml_text import read_yaml

PAGE = (Path(__file__).parents[2] / "docs" / "trajectories.md").read_text(encoding="utf-8")
LIMITS = JointLimits([-1.0, -1.0], [1.0, 1.1], [3.0, 3.0], [np.inf, np.inf], [np.inf, np.inf])


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_program_on_the_page_prints_the_output_on_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks("python")[0], "trajectories.md", "exec"), {})
    assert capsys.readouterr().out == blocks("text")[0]


def test_the_scenarios_on_the_page_can_be_built_from_the_files_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "motion.csv").write_text(blocks("csv")[0], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    quintic, csv = (
        TypeAdapter(TrajectoryDescription).validate_python(read_yaml(text)["trajectory"]).build(LIMITS)
        for text in blocks("yaml")
    )
    assert float(quintic.times[0]) == 0.5
    np.testing.assert_array_equal(csv.times, [0.0, 1.2, 2.0])


def test_ros_message_on_the_page_is_read() -> None:
    assert float(Tabulated.from_joint_trajectory(blocks("json")[0]).until) == 2.0


def test_every_trajectory_kind_is_on_the_page() -> None:
    kinds = TypeAdapter(TrajectoryDescription).json_schema()["discriminator"]["mapping"]
    assert all(f"| `{kind}` |" in PAGE for kind in kinds)
