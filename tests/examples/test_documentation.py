"""The code that the documentation shows runs."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")


BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@cache
def names() -> dict[str, Any]:
    """What the blocks define, run one after the other as a reader would."""
    found: dict[str, Any] = {}
    for code in BLOCKS:
        exec(compile(code, "extending.md", "exec"), found)
    return found


def test_the_scheme_on_the_page_about_extending_is_short_and_tracks() -> None:
    scheme = BLOCKS[0].split("class ")[1].split("\n\n\n")[0]
    assert len([line for line in scheme.splitlines() if line.strip()]) <= 30
    run = names()["run"]
    assert run.outcome.ok
    assert np.max(run.tally.steady_error) < 2e-3


def test_the_sensor_and_the_estimator_there_are_used_and_the_error_is_the_sensors() -> None:
    biased = names()["biased"]
    assert biased.outcome.ok
    # The arm is brought to where the sensor says that it should be.
    np.testing.assert_allclose(biased.tally.steady_error, [1e-4, 0.0], atol=1e-6)
