"""The numbers of docs/c-export.md on long runs: instructions as another program counts them, and what the law keeps."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmarks.long_run.__main__ import built, counts

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed"),
]

STEPS = 300


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built("example-4.1-1khz", tmp_path_factory.mktemp("law"))[0]


@pytest.mark.skipif(
    shutil.which("qemu-x86_64") is None or shutil.which("valgrind") is None,
    reason="QEMU and valgrind are not installed",
)
def test_instructions_are_those_that_valgrind_counts(program: Path) -> None:
    found = counts(program, STEPS, 0.0)
    assert found[:, 1].sum() == STEPS - 1
    # Calls to step_begins and step_ends are no part of the step; valgrind's processor has other elementary functions.
    expected = (collected(program, STEPS) - collected(program, 1)) / (STEPS - 1)
    assert (found[:, 0] * found[:, 1]).sum() / (STEPS - 1) == pytest.approx(expected, rel=0.01)


def collected(program: Path, steps: int) -> int:
    profiler = ["valgrind", "--tool=callgrind", "--toggle-collect=slidax_law_step"]
    command = [*profiler, f"--callgrind-out-file={program}.out", program, str(steps), str(steps), "0"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    found = re.search(r"Collected : (\d+)", said)
    assert found is not None
    return int(found[1])


def test_what_is_kept_is_read_where_it_is(program: Path) -> None:
    said = subprocess.run([program, "300", "100", "0"], capture_output=True, text=True, check=True).stdout
    lines = [line.split() for line in said.splitlines()]
    assert [int(line[0]) for line in lines] == [100, 200, 300]
    for count, bad, _, _, *numbers in lines:
        kept = {key: float(value) for key, value in (one.split("=") for one in numbers)}
        # The drives bear 60 N m.
        assert kept["t"] == kept["law_t"] == pytest.approx(1e-3 * (int(count) - 1), abs=1e-9)
        assert 0.0 < kept["tau"] <= 60.0 and bad == "0"
        assert 0.0 < kept["law_adapted_memory_information"] < 1.0 + 1e-12
