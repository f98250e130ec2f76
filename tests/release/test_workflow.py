import os
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
JOBS = YAML(typ="safe").load((ROOT / ".github" / "workflows" / "checks.yml").read_text())["jobs"]


@pytest.mark.parametrize("job", JOBS)
def test_each_ci_job_runs_scripts_of_the_repository(job):
    commands = [step["run"] for step in JOBS[job]["steps"] if "run" in step]
    assert commands and all(os.access(ROOT / command, os.X_OK) for command in commands)
