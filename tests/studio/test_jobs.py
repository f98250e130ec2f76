import json
import os
import time
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="the extra `studio` is not installed")
pytest.importorskip("httpx2", reason="Starlette's test client needs httpx2")


from slidax.studio.files import Folder
from slidax.studio.jobs import command_of

from .tricks import SECRET


def ended(client, job, seconds=60.0):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        state = client.get(f"/api/jobs/{job['id']}").json()
        if state["state"] not in ("waiting", "running"):
            return state
        time.sleep(0.1)
    raise AssertionError(f"the job hangs: {state}")


def alive(pid):
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


@pytest.mark.full
def test_a_job_whose_input_file_names_a_file_outside_the_folder_fails(client, shared_root):
    (shared_root / "bad.yaml").write_text("study: monte_carlo\nscenario: ../outside/secret.yaml\nruns: 10\nseed: 1\n")
    job = ended(client, client.post("/api/jobs", json={"kind": "study", "options": {"file": "bad.yaml"}}).json())
    assert (job["state"], job["code"]) == ("failed", 2) and "outside the studio's folder" in job["log"]
    assert SECRET not in json.dumps(job)


def test_a_job_writes_its_files_and_its_report_is_served_in_a_sandbox(client, shared_root):
    request = {"scenario": "example-4.1-1khz", "set": {"simulation.t1": 1.0}, "out": "results/one"}
    job = ended(client, client.post("/api/jobs", json={"kind": "run", "options": request}).json())
    assert (job["state"], job["code"], job["answer"]["outcome"]) == ("done", 0, "ok"), job
    left = {path.name for path in (shared_root / "results/one").iterdir()}
    assert {"report.html", "log.parquet", "scenario.yaml"} <= left
    report = client.get(job["links"][0]["at"], headers={"x-slidax-token": ""})
    assert report.status_code == 200 and report.headers["content-security-policy"].startswith("sandbox")
    key = job["links"][0]["at"].split("/")[2]
    assert client.get(f"/results/{key}/own.yaml").status_code == 404
    assert client.get(f"/results/{key}/results/one/../../own.yaml").status_code in (403, 404)
    assert client.get(f"/results/x{key}/results/one/report.html").status_code == 404
    again = client.post("/api/jobs", json={"kind": "run", "options": request})
    assert (again.status_code, again.json()["exists"]) == (409, True)


def test_a_second_job_that_writes_the_same_folder_is_refused_and_not_offered_to_overwrite(client):
    request = {"kind": "run", "options": {"scenario": "panda-payload", "out": "results/two"}}
    first = client.post("/api/jobs", json=request).json()
    second = client.post("/api/jobs", json=request)
    assert second.status_code == 422 and "exists" not in second.json()
    assert "another job is writing" in second.json()["error"]["message"]
    assert client.delete(f"/api/jobs/{first['id']}").json()["state"] == "cancelled"


def test_a_cancelled_job_and_its_children_end(client):
    request = {"scenario": "panda-payload", "runs": 100000}
    job = client.post("/api/jobs", json={"kind": "certify", "options": request}).json()
    while client.get(f"/api/jobs/{job['id']}").json()["state"] == "waiting":
        time.sleep(0.05)
    time.sleep(1.0)
    running = [pid for pid in os.listdir("/proc") if pid.isdigit() and is_process_of(pid, job["command"].split()[1])]
    assert running and client.delete(f"/api/jobs/{job['id']}").json()["state"] == "cancelled"
    assert not any(alive(int(pid)) for pid in running)
    assert client.delete(f"/api/jobs/{job['id']}").status_code == 200
    assert client.get(f"/api/jobs/{job['id']}").status_code == 404


def is_process_of(pid, word):
    try:
        line = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return False
    return "slidax.studio.confined" in line and f'"{word}"' in line


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("rm", {}, "unknown job"),
        ("run", {}, "is required"),
        ("run", {"scenario": "--help"}, "not a valid name"),
        ("run", {"scenario": "example-4.1", "view": True}, "unknown"),
        ("run", {"scenario": "example-4.1", "set": {"a=b --out": 1}}, "not the path"),
        ("certify", {"scenario": "example-4.1", "runs": "1; ls"}, "number"),
        ("certify", {"scenario": "example-4.1", "runs": True}, "number"),
        ("compare", {"scenario": "example-4.1", "schemes": "a,--out=x"}, "not a valid name"),
        ("export-c", {"scenario": "example-4.1"}, "the file or folder to write"),
        ("design", {"requirements": "own.yaml", "out": "x.py"}, "must end in"),
    ],
)
def test_invalid_options_of_a_job_are_refused(client, kind, options, message):
    answer = client.post("/api/jobs", json={"kind": kind, "options": options})
    assert answer.status_code == 422 and message in answer.json()["error"]["message"]


def test_a_command_with_a_report_writes_the_report_and_the_result(tmp_path):
    (tmp_path / "log.csv").write_text("t\n")
    options = {"log": "log.csv", "robot": "panda", "out": "arm.yaml", "report": "report"}
    command = command_of(Folder(tmp_path), "identify", options)
    assert command.writes == ["arm.yaml", "report"] and command.out == "report"
