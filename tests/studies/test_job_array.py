"""A study as a job array: parts into one folder, and a closing `--resume`."""

import os
import re
import shlex
import subprocess

import pytest

from scripts.documentation.pages import blocks
from slidax.core.writing import write_text
from slidax.studies import store
from tests.cli.commands import STUDY, in_process
from tests.documentation.pages import ROOT

TEXT = STUDY + "runs: 256"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the study into a folder of this name."""
    for name in ("LEAST", "MOST"):
        monkeypatch.setattr(f"slidax.studies.runner.{name}", 64)
    file = tmp_path / "my-study.yaml"
    write_text(file, TEXT)
    return lambda out, *options: in_process("study", str(file), "--out", str(tmp_path / out), *options, code=0)


def parts(folder):
    return {path.name: path.read_bytes() for path in (folder / store.PARTS).iterdir()}


def test_three_parts_of_a_job_array_are_disjoint_and_together_equal_the_whole_study(run, tmp_path):
    run("whole")
    names = []
    for i in (1, 2, 3):
        before = set(parts(tmp_path / "rows")) if i > 1 else set()
        assert ("is done" in run("rows", "--part", f"{i}/3").stdout) == (i < 3)
        names.append(set(parts(tmp_path / "rows")) - before)
    assert [len(each) for each in names] == [2, 1, 1]
    assert parts(tmp_path / "rows") == parts(tmp_path / "whole")
    whole, rows = ((tmp_path / name / "rows.parquet").read_bytes() for name in ("whole", "rows"))
    assert whole == rows


def test_the_final_resume_lists_missing_rows_and_writes_the_report(run, tmp_path):
    run("whole")
    for i in (1, 3):
        run("rows", "--part", f"{i}/3")
    assert not (tmp_path / "rows" / "report.html").exists()
    closing = run("rows", "--resume")
    assert "64 of 256 rows are missing and are computed now: 64 to 127" in closing.stderr
    assert (tmp_path / "rows" / "report.html").exists()
    assert (tmp_path / "rows" / "rows.parquet").read_bytes() == (tmp_path / "whole" / "rows.parquet").read_bytes()
    assert "missing" not in run("rows", "--resume").stderr


@pytest.mark.parametrize(
    ("have", "missing"),
    [
        ([], [range(200)]),
        ([(64, 64)], [range(64), range(128, 200)]),
        ([(0, 64), (0, 256)], []),
        ([(192, 64)], [range(192)]),
    ],
)
def test_missing_rows_are_the_gaps_between_parts(have, missing, tmp_path):
    (tmp_path / store.PARTS).mkdir()
    for first, rows in have:
        (tmp_path / store.PARTS / f"{first:012d}-{rows}.parquet").touch()
    assert store.missing_rows(tmp_path, 200) == missing


def bash(script, folder, **environment):
    """Return the `slidax` and `sbatch` command lines that a shell script calls."""
    tools = 'slidax() { printf "%q " slidax "$@" >> calls; echo >> calls; }\n'
    tools += 'sbatch() { printf "%q " sbatch "$@" >> calls; echo >> calls; echo 77; }\n'
    subprocess.run(["bash", "-eu", "-c", tools + script], cwd=folder, env={**os.environ, **environment}, check=True)
    lines = (folder / "calls").read_text().splitlines()
    (folder / "calls").unlink()
    return [shlex.split(line) for line in lines]


def test_the_documented_slurm_job_array_covers_every_part_and_writes_the_report(run, tmp_path):
    text = [block.text for block in blocks((ROOT / "docs/studies.md").read_text()) if "sbatch" in block.text.lower()]
    array, closing = text
    first, last = map(int, re.search(r"^#SBATCH --array=(\d+)-(\d+)$", array, re.M).groups())
    arrays = [bash(array, tmp_path, SLURM_ARRAY_TASK_ID=str(i)) for i in range(first, last + 1)]
    assert [line[-1] for (line,) in arrays] == [f"{i}/{last}" for i in range(1, last + 1)]
    (submit, after) = bash(closing, tmp_path)
    assert submit == ["sbatch", "--parsable", "study.sbatch"] and "--dependency=afterany:77" in after
    for line in (arrays[1][0], shlex.split(after[-1])):
        assert line[:3] == ["slidax", "study", "my-study.yaml"] and line[3:5] == ["--out", "rows"]
        run("rows", *line[5:])
    assert (tmp_path / "rows" / "report.html").exists()
