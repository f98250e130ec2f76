import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
JOBS = YAML(typ="safe").load((ROOT / ".github" / "workflows" / "checks.yml").read_text())["jobs"]


def commands(job):
    return [step["run"] for step in JOBS[job]["steps"] if "run" in step]


@pytest.mark.parametrize("job", JOBS)
def test_each_ci_job_runs_scripts_of_the_repository(job):
    assert commands(job) and all(os.access(ROOT / command, os.X_OK) for command in commands(job))


def test_every_script_of_ci_is_run_by_a_job():
    scripts = {path.relative_to(ROOT).as_posix() for path in (ROOT / ".ci").iterdir()}
    assert scripts == {command for job in JOBS for command in commands(job)}


def test_the_pages_job_selects_the_test_of_all_pages():
    (arguments,) = re.findall(r'^make test ARGS="(.*)"$', (ROOT / ".ci" / "pages").read_text(), re.MULTILINE)
    selection = [sys.executable, "-m", "pytest", "--collect-only", "-q", *arguments.split()]
    selected = subprocess.run(selection, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    assert "tests/documentation/test_pages.py::test_the_code_of_all_pages_runs" in selected
