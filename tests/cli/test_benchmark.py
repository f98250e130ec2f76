import json

import pytest

from .commands import own_process


@pytest.mark.full
def test_a_small_benchmark_runs_in_processes_and_resumes(tmp_path):
    command = ("benchmark", "--small", "--tasks", "scara-slow", "--schemes", "pid,gravity_pd", "--out", str(tmp_path))
    first = own_process(*command, "--json", "--processes", "2")
    assert first.returncode == 0, first.stderr
    (table,) = json.loads(first.stdout)["tasks"].values()
    assert {(item["scheme"], item["form"]) for item in table["schemes"]} == {
        (scheme, form) for scheme in ("pid", "gravity_pd") for form in ("printed", "sampled-data")
    }
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("runs/*/*.json")}
    assert len(kept) == 4 and own_process(*command).returncode == 0
    assert kept == {path: path.stat().st_mtime_ns for path in kept}
