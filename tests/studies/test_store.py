"""Rows on disk: whole or not at all, none lost, none twice, whatever stopped the study."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.studies import RunOptions, read_rows
from slidax.studies.runner import Runner

from .files import STUDY, ran, study

RUNNER = """
import sys, json, jax
jax.config.update("jax_enable_x64", True)
from pathlib import Path
from slidax.studies import RunOptions, study_of
from slidax.studies import runner
runner.LEAST = runner.MOST = 64
print("begin", flush=True)
options = RunOptions(Path(sys.argv[2]), True, progress=lambda rows: print(rows, flush=True))
study_of(json.loads(sys.argv[1])).run(options)
"""


def killed_after(seconds: float, out: Path, **changes: Any) -> bool:
    """Whether the study, resumed in a process that is killed after so long, came to its end."""
    import json

    text = json.dumps({**STUDY, **changes})
    with subprocess.Popen([sys.executable, "-c", RUNNER, text, str(out)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            return process.wait(seconds) == 0
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            return False


def kill_until_done(out: Path, most: int, seed: int, low: float, high: float, **changes: Any) -> int:
    random = np.random.default_rng(seed)
    kills = 0
    while kills < most and not killed_after(float(random.uniform(low, high)), out, **changes):
        kills += 1
    assert killed_after(600.0, out, **changes)
    return kills


def assert_same_rows(one: Path, other: Path, rows: int) -> None:
    table, expected = read_rows(one), read_rows(other)
    assert table["row"].tolist() == list(range(rows))
    assert table.keys() == expected.keys()
    for name, column in expected.items():
        assert np.array_equal(table[name], column, equal_nan=True), name
    assert (one / "rows.parquet").read_bytes() == (other / "rows.parquet").read_bytes()


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slidax.studies.runner.LEAST", 64)
    monkeypatch.setattr("slidax.studies.runner.MOST", 64)


@pytest.mark.usefixtures("small_chunks")
def test_a_study_that_was_killed_goes_on_and_ends_with_the_same_file(tmp_path: Path) -> None:
    ran(tmp_path / "whole")
    out = tmp_path / "out"

    class Stopped(Exception):
        pass

    points = []

    def stop(rows: int) -> None:
        points.append(rows)
        if len(points) == 2:
            raise Stopped

    with pytest.raises(Stopped):
        study().run(RunOptions(out, progress=stop))
    assert not (out / "rows.parquet").exists() and len(list((out / "parts").iterdir())) == 2
    # A part that was being written is no part, and a damaged one is computed again.
    (out / "parts" / "000000000128-64.tmp77").write_bytes(b"half of a file")
    (out / "parts" / "000000000064-64.parquet").write_bytes(b"PAR1")
    with pytest.warns(
        DefinitionWarning, match="000000000064-64.parquet` is damaged .*: its 64 rows are computed again"
    ):
        result = ran(out, resume=True)
    assert result.computed == 136
    assert_same_rows(out, tmp_path / "whole", 200)


@pytest.mark.full
def test_twenty_kills_at_random_moments_lose_no_row(tmp_path: Path) -> None:
    changes = {"runs": 6000, "changes": {"simulation.t1": 1}}
    assert killed_after(600.0, tmp_path / "whole", **changes)
    started = time.monotonic()
    assert killed_after(600.0, tmp_path / "timed", **changes)
    whole = time.monotonic() - started
    kills = kill_until_done(tmp_path / "out", 20, 1, 0.2 * whole, 0.5 * whole, **changes)
    assert kills >= 1
    while kills < 20:
        again = tmp_path / f"again{kills}"
        kills += max(kill_until_done(again, 20 - kills, kills, 0.2 * whole, 0.5 * whole, **changes), 1)
        assert_same_rows(again, tmp_path / "whole", 6000)
    assert_same_rows(tmp_path / "out", tmp_path / "whole", 6000)


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    ran(tmp_path / "out", runs=64)
    with pytest.raises(DefinitionError, match="--resume"):
        ran(tmp_path / "out", runs=64)
    with pytest.raises(DefinitionError, match="another study"):
        ran(tmp_path / "out", resume=True, seed=6, runs=64)
    with pytest.raises(DefinitionError, match="another study"):
        ran(tmp_path / "out", resume=True, changes={"simulation.t1": 0.3}, runs=64)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("", encoding="utf-8")
    with pytest.raises(DefinitionError, match="is not empty"):
        ran(tmp_path / "other", runs=64)


def test_more_runs_of_the_same_study_keep_those_that_are_done(tmp_path: Path) -> None:
    ran(tmp_path / "out", runs=64)
    for runs in (80, 200, 100):
        result = ran(tmp_path / "out", resume=True, runs=runs)
        assert result.runs == runs
        assert np.array_equal(read_rows(tmp_path / "out")["row"], np.arange(runs))


def test_a_chunk_has_a_few_seconds_of_work() -> None:
    assert [Runner.rows_of_chunk(samples) for samples in (10, 2000, 8000, 10**7)] == [8192, 2048, 512, 64]
