"""No single fault of a sensor, the clock or the planner makes an exported law run away."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from slidax.deploy.project import STEP, project, write_files
from slidax.scenarios import load

from .exported import COMPILERS, needs_a_compiler

pytestmark = needs_a_compiler

CAMPAIGN = Path(__file__).with_name("campaign") / "campaign.c"
KINDS = 20

EXPORTS = ["panda-payload", "ur5e-payload", "example-4.1-1khz", "example-4.2-1khz"]


def disturbed(name: str, single: bool, times: int, seed: int, folder: Path) -> str:
    """The report of a campaign: a line for each kind of fault, and the number of bad runs."""
    scenario = load(name)
    made = project(scenario, name="law", single=single, with_golden=False)
    write_files(made, folder, STEP)
    performance = scenario.controller.step.transformation.performance
    sources = ["slidax_law.c", "slidax_law_scenario.c", str(CAMPAIGN)]
    real = f"-DREAL={'float' if single else 'double'}"
    # gnu11: the campaign itself is no part of an export.
    command = [COMPILERS[0], "-std=gnu11", "-O1", real, "-I.", *sources, "-o", "campaign", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    deadline = f"{float(performance.deadline.max()):g}"
    done = subprocess.run(
        ["./campaign", str(times), str(seed), deadline], cwd=folder, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr[-3000:]}"
    return done.stdout


@pytest.mark.parametrize(("name", "single"), [("panda-payload", False), ("example-4.1-1khz", True)])
def test_after_a_fault_the_joints_come_back_in_time_or_the_host_is_asked_to_stop(name, single, tmp_path):
    report = disturbed(name, single, 6, 1, tmp_path)
    assert f"all: {6 * KINDS} runs, 0 bad" in report


@pytest.mark.full
@pytest.mark.parametrize("single", [False, True], ids=["doubles", "floats"])
@pytest.mark.parametrize("name", EXPORTS)
def test_no_fault_at_200_random_times_makes_a_law_run_away(name, single, tmp_path):
    report = disturbed(name, single, 200, 11, tmp_path)
    print(f"{name}, {'floats' if single else 'doubles'}\n{report}")
    assert f"all: {200 * KINDS} runs, 0 bad" in report
