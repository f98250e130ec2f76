"""Rows on disk: whole or absent, none lost or doubled, from one process and from several."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.core.writing import is_temporary
from slidax.studies import Part, PartDone, RunOptions, read_rows
from slidax.studies.runner import Runner
from tests.studies.files import STUDY, ran, study

PROCESS = """
import sys, json, jax
jax.config.update("jax_enable_x64", True)
from pathlib import Path
from slidax.studies import Part, PartDone, RunOptions, study_of
from slidax.studies import runner
runner.LEAST = runner.MOST = 64
text, out, part = sys.argv[1:]
print("begin", flush=True)
part = Part.parsed(part) if part else None
try:
    study_of(json.loads(text)).run(RunOptions(Path(out), True, part=part))
except PartDone as done:
    print("missing", done.missing, flush=True)
else:
    print("whole", flush=True)
"""


def killed_after(seconds: float, out: Path, **changes: Any) -> bool:
    """True if the resumed study ended before its process was killed after `seconds`."""
    text = json.dumps({**STUDY, **changes})
    with subprocess.Popen([sys.executable, "-c", PROCESS, text, str(out), ""], stdout=subprocess.PIPE) as process:
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


def assert_same_rows(folder: Path, other: Path, rows: int) -> None:
    table, expected = read_rows(folder), read_rows(other)
    assert table["row"].tolist() == list(range(rows)) and table.keys() == expected.keys()
    for name, column in expected.items():
        assert np.array_equal(table[name], column, equal_nan=True), name
    assert (folder / "rows.parquet").read_bytes() == (other / "rows.parquet").read_bytes()


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr("slidax.studies.runner.LEAST", 64)
    monkeypatch.setattr("slidax.studies.runner.MOST", 64)


@pytest.mark.usefixtures("small_chunks")
def test_a_killed_study_resumes_and_ends_with_the_same_file(tmp_path):
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
    # An incomplete part is ignored, and a damaged part is computed again.
    (out / "parts" / "000000000128-64.tmp77").write_bytes(b"half of a file")
    (out / "parts" / "000000000064-64.parquet").write_bytes(b"PAR1")
    with pytest.warns(
        DefinitionWarning, match="000000000064-64.parquet` is damaged .*: its 64 rows are computed again"
    ):
        result = ran(out, resume=True)
    assert result.computed == 136
    assert_same_rows(out, tmp_path / "whole", 200)


@pytest.mark.full
def test_twenty_kills_at_random_moments_lose_no_row(tmp_path):
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


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_folder_with_another_study_or_other_files_is_refused_and_unchanged(tmp_path):
    ran(tmp_path / "out", runs=64)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("", encoding="utf-8")
    before = contents(tmp_path)
    with pytest.raises(DefinitionError, match="--resume"):
        ran(tmp_path / "out", runs=64)
    with pytest.raises(DefinitionError, match="another study"):
        ran(tmp_path / "out", resume=True, seed=6, runs=64)
    with pytest.raises(DefinitionError, match="another study"):
        ran(tmp_path / "out", resume=True, changes={"simulation.t1": 0.3}, runs=64)
    with pytest.raises(DefinitionError, match="is not empty"):
        ran(tmp_path / "other", runs=64)
    assert contents(tmp_path) == before


def test_a_resumed_study_with_more_or_fewer_runs_has_exactly_these_rows(tmp_path):
    ran(tmp_path / "out", runs=64)
    for runs in (80, 200, 100):
        result = ran(tmp_path / "out", resume=True, runs=runs)
        assert result.runs == runs and np.array_equal(read_rows(tmp_path / "out")["row"], np.arange(runs))


def test_chunks_have_fewer_rows_for_longer_runs():
    assert [Runner.rows_of_chunk(samples) for samples in (10, 2000, 8000, 10**7)] == [8192, 2048, 512, 64]


def begun(out: Path, part: str = "", **changes: Any) -> subprocess.Popen[str]:
    """Start a process that runs the study or a part of it."""
    command = [sys.executable, "-W", "error", "-c", PROCESS, json.dumps({**STUDY, **changes}), str(out), part]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process


def ended(processes: Sequence[subprocess.Popen[str]]) -> list[str]:
    """Return the last line of each process, none of which may fail or warn."""
    lines = []
    for process in processes:
        out, errors = process.communicate(timeout=600)
        assert (process.returncode, errors) == (0, "")
        lines.append(out.splitlines()[-1])
    return lines


def assert_clean(out: Path) -> None:
    assert not [path for path in out.rglob("*") if is_temporary(path.name)]


@pytest.mark.full
@pytest.mark.usefixtures("small_chunks")
def test_two_processes_in_a_folder_write_the_same_table_as_a_single_process(tmp_path):
    ran(tmp_path / "alone")
    processes = [begun(tmp_path / "out") for _ in range(2)]
    assert ended(processes) == ["whole", "whole"]
    assert_same_rows(tmp_path / "out", tmp_path / "alone", 200)
    assert_clean(tmp_path / "out")


@pytest.mark.usefixtures("small_chunks")
def test_the_last_part_to_finish_joins_all_parts(tmp_path):
    ran(tmp_path / "alone")
    out = tmp_path / "out"
    with pytest.raises(PartDone) as done:
        study().run(RunOptions(out, part=Part(2, 3)))
    assert (done.value.missing, done.value.total) == (136, 200) and not (out / "rows.parquet").exists()
    with pytest.raises(PartDone) as done:
        study().run(RunOptions(out, part=Part(1, 3)))
    assert done.value.missing == 64
    last = study().run(RunOptions(out, part=Part(3, 3)))
    assert (last.computed, last.runs) == (64, 200)
    assert_same_rows(out, tmp_path / "alone", 200)
    with pytest.raises(DefinitionError, match="another study"):
        study(seed=6).run(RunOptions(out, part=Part(3, 3)))


COMPARE = {"study": "compare", "schemes": {"ours": {}, "wider": {"scheme.performance.final": 0.006}}, "runs": 128}


@pytest.mark.full
@pytest.mark.usefixtures("small_chunks")
def test_a_comparison_in_two_parts_gives_the_rows_of_the_whole_comparison(tmp_path):
    request = study(**COMPARE)
    request.run(RunOptions(tmp_path / "alone"))
    with pytest.raises(PartDone) as done:
        request.run(RunOptions(tmp_path / "out", part=Part(1, 2)))
    assert (done.value.missing, done.value.total) == (128, 256)
    request.run(RunOptions(tmp_path / "out", part=Part(2, 2)))
    for name in ("ours", "wider"):
        assert_same_rows(tmp_path / "out" / name, tmp_path / "alone" / name, 128)


@pytest.mark.parametrize("text", ["", "1", "0/2", "3/2", "1/0", "a/b", "1/2/3", "-1/2", "1.0/2", "１/２", "1/99999999"])
def test_a_malformed_part_of_a_study_is_refused_with_an_example(text):
    with pytest.raises(DefinitionError, match=r"such as 2/4"):
        Part.parsed(text)


def test_a_part_is_refused_for_studies_with_dependent_rows(tmp_path):
    with pytest.raises(DefinitionError, match="the rows of monte_carlo with `until` depend on earlier results"):
        study(until={"probability": 0.9}).run(RunOptions(tmp_path / "out", part=Part(1, 2)))
    with pytest.raises(DefinitionError, match="the rows of falsify depend on earlier results"):
        study(study="falsify", runs=64).run(RunOptions(tmp_path / "out", part=Part(1, 2)))
    with pytest.raises(DefinitionError, match="--out"):
        study().run(RunOptions(part=Part(1, 2)))
    assert not (tmp_path / "out").exists()


LONG = {"runs": 1280, "changes": {"simulation.t1": 1}}


@pytest.mark.full
def test_two_processes_on_one_folder_write_the_same_rows_in_twenty_trials(tmp_path):
    assert ended([begun(tmp_path / "alone", **LONG)]) == ["whole"]
    random = np.random.default_rng(38)
    for number in range(20):
        out = tmp_path / f"out{number}"
        first = begun(out, **LONG)
        time.sleep(float(random.choice([0.0, random.uniform(0.0, 4.0)])))
        assert ended([first, begun(out, **LONG)]) == ["whole", "whole"]
        assert_same_rows(out, tmp_path / "alone", 1280)
        assert_clean(out)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(5))
def test_a_killed_part_and_a_joining_process_lose_no_row(tmp_path, seed):
    assert ended([begun(tmp_path / "alone", **LONG)]) == ["whole"]
    out, random = tmp_path / "out", np.random.default_rng(seed)
    first, second = begun(out, "1/2", **LONG), begun(out, "2/2", **LONG)
    until = time.monotonic() + 120
    while len(list(out.glob("parts/*.parquet"))) < 2:
        assert time.monotonic() < until
        time.sleep(0.01)
    time.sleep(float(random.uniform(0.0, 0.3)))
    second.send_signal(signal.SIGKILL)
    second.communicate()
    third = begun(out, **LONG)
    last = ended([first, third])
    assert last[1] == "whole" and last[0].startswith(("whole", "missing"))
    assert_same_rows(out, tmp_path / "alone", 1280)
    # The next process removes a file that the killed process left.
    assert ended([begun(out, "2/2", **LONG)]) == ["whole"]
    assert_clean(out)
