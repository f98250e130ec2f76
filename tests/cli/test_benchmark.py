import json

import pytest

from tests.rivals import USERS_LAW

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


@pytest.mark.full
def test_benchmark_accepts_a_user_law_file_and_locates_an_error_in_it(tmp_path, monkeypatch):
    file = tmp_path / "mine.py"
    monkeypatch.chdir(tmp_path)
    command = ("benchmark", "--small", "--tasks", "scara-slow", "--schemes", "pid", "--scheme", "mine:Mine")
    command = (*command, "--form", "sampled-data", "--processes", "1")
    file.write_text(USERS_LAW.replace("now.ddq - self.kp", "now.ddq - self.kq"), encoding="utf-8")
    wrong = own_process(*command)
    assert wrong.returncode == 0 and "pid (sampled-data)" in wrong.stdout
    line = next(i for i, text in enumerate(USERS_LAW.splitlines(), 1) if "now.ddq" in text)
    where = f"line {line} of {file}, in `Mine.__call__`"
    assert f"Mine (sampled-data) cannot run: {where}: AttributeError: " in wrong.stderr
    file.write_text(USERS_LAW, encoding="utf-8")
    right = own_process(*command, "--json")
    assert right.returncode == 0, right.stderr
    answer = json.loads(right.stdout)
    (scores,) = answer["tasks"].values()
    mine = next(score for score in scores["schemes"] if score["scheme"] == "mine:Mine")
    assert mine["failed"] < 1.0 and mine["medians"]["steady_error"] > 0.0 and answer["refused"] == []
    assert set(mine["gains"]) == {"scheme.kp", "scheme.inertia"} and len(mine["gains"]["scheme.inertia"]) == 3
