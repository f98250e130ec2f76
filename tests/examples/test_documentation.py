"""The code that the documentation shows runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")


def test_the_scheme_on_the_page_about_extending_is_short_and_tracks() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    scheme = code.split("class ")[1].split("\n\n\n")[0]
    assert len([line for line in scheme.splitlines() if line.strip()]) <= 30
    names: dict[str, object] = {}
    exec(compile(code, "extending.md", "exec"), names)
    run = names["run"]
    assert run.outcome.ok
    assert np.max(run.tally.steady_error) < 2e-3
