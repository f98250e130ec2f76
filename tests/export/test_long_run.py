import re
import shutil
import subprocess

import pytest

from benchmarks.long_run.__main__ import built, counts

pytestmark = [pytest.mark.full, pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")]

STEPS = 300


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return built("example-4.1-1khz", tmp_path_factory.mktemp("law"))[0]


@pytest.mark.skipif(
    shutil.which("qemu-x86_64") is None or shutil.which("valgrind") is None,
    reason="QEMU and valgrind are not installed",
)
def test_counted_instructions_agree_with_valgrind(program):
    result = counts(program, STEPS, 0.0)
    assert result[:, 1].sum() == STEPS - 1
    # Calls to step_begins and step_ends are no part of the step; valgrind's processor has other elementary functions.
    expected = (collected(program, STEPS) - collected(program, 1)) / (STEPS - 1)
    assert (result[:, 0] * result[:, 1]).sum() / (STEPS - 1) == pytest.approx(expected, rel=0.01)


def collected(program, steps):
    profiler = ["valgrind", "--tool=callgrind", "--toggle-collect=slidax_law_step"]
    command = [*profiler, f"--callgrind-out-file={program}.out", program, str(steps), str(steps), "0"]
    message = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    result = re.search(r"Collected : (\d+)", message)
    assert result is not None
    return int(result[1])


def test_the_long_run_program_reads_time_and_torque_from_the_laws_memory(program):
    message = subprocess.run([program, "300", "100", "0"], capture_output=True, text=True, check=True).stdout
    lines = [line.split() for line in message.splitlines()]
    assert [int(line[0]) for line in lines] == [100, 200, 300]
    for count, bad, _, _, *numbers in lines:
        kept = {key: float(value) for key, value in (item.split("=") for item in numbers)}
        # The drives bear 60 N m.
        assert kept["t"] == kept["law_t"] == pytest.approx(1e-3 * (int(count) - 1), abs=1e-9)
        assert 0.0 < kept["tau"] <= 60.0 and bad == "0"
        assert 0.0 < kept["law_adapted_memory_information"] < 1.0 + 1e-12
