import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the extra `studio` is not installed")
pytest.importorskip("httpx2", reason="Starlette's test client needs httpx2")


from slidax.scenarios import load

from .tricks import SECRET, state_of, tricks

PORT = 8577


def everywhere(name):
    job = [
        ("run", {"scenario": name}),
        ("run", {"scenario": "example-4.1", "out": name}),
        ("run", {"scenario": "example-4.1", "set": {"robot.file": name}, "out": name}),
        ("certify", {"scenario": name}),
        ("certify", {"scenario": "example-4.1", "out": name}),
        ("compare", {"scenario": name}),
        ("compare", {"scenario": "example-4.1", "out": name}),
        ("explain", {"run": name}),
        ("design", {"requirements": name, "out": "new.yaml"}),
        ("design", {"requirements": "own.yaml", "out": name}),
        ("excite", {"robot": name, "out": "new.csv"}),
        ("excite", {"robot": "panda", "out": name}),
        ("identify", {"log": name, "robot": "panda"}),
        ("identify", {"log": "own.csv", "robot": name}),
        ("identify", {"log": "own.csv", "robot": "panda", "out": name}),
        ("identify", {"log": "own.csv", "robot": "panda", "report": name}),
        ("study", {"file": name}),
        ("study", {"file": "own.yaml", "out": name}),
        ("export-c", {"scenario": name, "out": "new"}),
        ("export-c", {"scenario": "example-4.1", "out": name}),
        ("export-web", {"scenario": name, "out": "new"}),
        ("export-web", {"scenario": "example-4.1", "out": name}),
    ]
    return [
        ("GET", "/api/file", {"params": {"path": name}}),
        ("PUT", "/api/file", {"params": {"path": name}, "content": b"x: 1\n"}),
        *(("POST", f"/api/{do}", {"json": {"path": name}}) for do in ("check", "run", "manifest")),
        *(("POST", f"/api/{do}", {"json": {"name": name}}) for do in ("check", "run", "manifest")),
        ("POST", "/api/check", {"json": {"path": name, "text": "title: x"}}),
        ("POST", "/api/check", {"json": {"name": "example-4.1", "changes": {"robot.file": name}}}),
        ("POST", "/api/new", {"json": {"robot": name}}),
        *(
            ("POST", "/api/jobs", {"json": {"kind": kind, "options": message | {"replace": False}}})
            for kind, message in job
        ),
    ]


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.full), 8])
def test_no_path_trick_of_a_request_reaches_a_file_outside(client, shared_root, every):
    (shared_root / "own.csv").write_text("t\n")
    before, tried = state_of(shared_root.parent / "outside"), 0
    for name in tricks(shared_root)[::every]:
        for method, address, sent in everywhere(name):
            tried += 1
            answer = client.request(method, address, **sent)
            assert SECRET not in answer.text, (name, address, sent)
            if answer.status_code < 300:
                # The name is odd, but in the folder; its job is not part of this test.
                assert (shared_root / name).resolve().is_relative_to(shared_root), (name, address, sent)
                if address == "/api/jobs":
                    client.delete(f"/api/jobs/{answer.json()['id']}")
            else:
                assert answer.status_code in (403, 404, 409, 422), (answer.status_code, name, address, answer.text)
    assert tried >= 40 // every * 30 and state_of(shared_root.parent / "outside") == before
    assert sorted(path.name for path in shared_root.parent.iterdir()) == ["outside", "root"]


@pytest.mark.parametrize(
    "text",
    [
        "robot: {kind: urdf, file: ../outside/secret.urdf}",
        "robot: {kind: mjcf, file: folder/secret.xml}",
        "robot: {kind: identified, file: link.yaml}",
        "robot: {kind: two_link}\ntrajectory: {kind: csv, file: ../outside/secret.csv}",
        "uncertainty: {file: ../outside/secret.yaml}",
        "robot: {kind: urdf, file: inner.xml}",
        "robot: {kind: mjcf, file: inner.xml}",
    ],
)
def test_files_named_in_a_file_are_not_read_outside_the_folder(client, shared_root, text):
    (shared_root / "inner.xml").write_text('<mujoco><include file="../outside/secret.xml"/><worldbody/></mujoco>')
    (shared_root / "names.yaml").write_text(text)
    for do, payload in (
        ("check", {"text": text}),
        ("run", {"path": "names.yaml"}),
        ("manifest", {"path": "names.yaml"}),
    ):
        answer = client.post(f"/api/{do}", json=payload)
        assert answer.status_code in (403, 422) and SECRET not in answer.text
    assert "outside the studio's folder" in client.post("/api/run", json={"path": "names.yaml"}).text


def test_a_run_in_the_studio_equals_that_in_python(client):
    changes = {"scheme.performance.final": 0.004, "simulation.t1": 1.0}
    answer = client.post("/api/run", json={"name": "example-4.1-1khz", "changes": changes})
    (length,) = struct.unpack("<Q", answer.content[:8])
    head = json.loads(answer.content[8 : 8 + length])
    numbers, at, result = np.frombuffer(answer.content[8 + length :], "<f8"), 0, {}
    for item in head["signals"]:
        size = head["rows"] * item["width"]
        result[item["name"]] = numbers[at : at + size].reshape(head["rows"], -1)
        at += size
    run = load("example-4.1-1khz", changes).simulate(log_every=1)
    assert head["outcome"]["kind"] == "ok" and at == numbers.size
    np.testing.assert_allclose(result["e"], run.log.e, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(result["tau"], run.log.tau, rtol=1e-12, atol=1e-12)
    assert (result["lower"] < result["e"]).all() and (result["e"] < result["upper"]).all()
    assert min(head["metrics"]["envelope_margin"]) == pytest.approx(float(result["margin"].min()), rel=1e-9)


def test_an_invalid_field_is_reported_with_its_path_and_remedy(client):
    answer = client.post("/api/check", json={"name": "example-4.1", "changes": {"scheme.surface.k9": 1}})
    assert answer.status_code == 422
    assert answer.json()["error"]["where"] == "scheme.surface"
    assert answer.json()["error"]["message"].startswith("unknown key `k9`; there are: `kind`, `k1`")
    broken = client.post("/api/check", json={"text": "robot: [", "path": "x.yaml"})
    assert "not valid YAML" in broken.json()["error"]["message"]


@pytest.mark.full
def test_scara_and_panda_scenarios_become_playgrounds_with_valid_tunable_parameters(client):
    for name in ("example-4.2-1khz", "panda-payload"):
        reply = client.post("/api/manifest", json={"name": name}).json()["manifest"]
        first = reply["settings"][0]
        assert {"printed", "rival", "ours"} == {item["kind"] for item in reply["settings"]}
        assert first["tunables"] and len(first["variants"]) == np.prod(
            [len(item["values"]) for item in first["choices"]]
        )
        tunable = next(item for item in first["tunables"] if item["path"].endswith("performance.final"))
        changed = client.post("/api/check", json={"name": name, "changes": {tunable["path"]: tunable["default"]}})
        assert changed.status_code == 200, changed.text


URDF = """<robot name="three"><link name="base"/>{links}</robot>"""
LINK = """<link name="l{k}"><inertial><origin xyz="0 0 0.15"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin xyz="0 0 0.3"/>
<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="2" effort="{effort}"/></joint>"""


@pytest.mark.full
def test_an_uploaded_arm_becomes_a_saved_scenario_that_runs(client, shared_root):
    joints = [("base", "0 0 1", 3, 60), ("l0", "0 1 0", 2, 60), ("l1", "0 1 0", 1, 30)]
    links = "".join(
        LINK.format(k=k, parent=parent, axis=axis, mass=mass, effort=effort)
        for k, (parent, axis, mass, effort) in enumerate(joints)
    )
    brought = client.put("/api/file?path=arms/three.urdf", content=URDF.format(links=links).encode())
    assert brought.status_code == 200
    reply = client.post("/api/new", json={"robot": "arms/three.urdf", "rate": 500}).json()
    assert "file: arms/three.urdf" in reply["text"]
    assert client.put("/api/file?path=three.yaml", content=reply["text"].encode()).status_code == 200
    playground = client.post("/api/manifest", json={"path": "three.yaml"}).json()["manifest"]
    # The page sends back the same scenario, from the folder.
    text = json.dumps(playground["settings"][0]["scenario"])
    changes = {"simulation.t1": 0.5}
    answer = client.post("/api/run", json={"text": text, "path": "playground.yaml", "changes": changes})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/octet-stream"


def test_a_file_changed_by_another_program_is_not_overwritten(client, shared_root):
    saved = client.put("/api/file?path=mine.yaml", content=b"title: a\n").json()
    assert client.get("/api/file?path=mine.yaml").json() == {"path": "mine.yaml", "text": "title: a\n", **saved}
    (shared_root / "mine.yaml").write_text("title: b\n")
    again = client.put("/api/file?path=mine.yaml", content=b"title: c\n", headers={"if-match": saved["mark"]})
    assert (again.status_code, again.json()["exists"]) == (409, True)
    assert (shared_root / "mine.yaml").read_text() == "title: b\n"


@pytest.mark.full
def test_a_dead_worker_process_is_replaced_at_the_next_request(client):
    # The compiler, which another test may have started, is such a process, too.
    benches = [int(pid) for pid in os.listdir("/proc") if pid.isdigit() and is_bench(pid)]
    assert benches
    for bench in benches:
        os.kill(bench, 9)
    first = client.post("/api/check", json={"name": "example-4.1"})
    second = client.post("/api/check", json={"name": "example-4.1"})
    assert second.status_code == 200 and first.status_code in (200, 422)


def is_bench(pid):
    try:
        line = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
        parent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1]
    except OSError:
        return False
    return "slidax.studio.bench" in line and int(parent) == os.getpid()


def test_malformed_requests_are_refused_with_a_message(client):
    for body in (b"", b"[]", b"NaN", b'{"a":', b'{"a":NaN}', b"[" * 100_000):
        answer = client.post("/api/run", content=body, headers={"content-type": "application/json"})
        assert answer.status_code == 400 and answer.json()["error"]["message"]
    assert client.post("/api/warm", json={}).status_code == 404
    assert client.post("/api/new", json={}).json()["error"] == {"where": "robot", "message": "this field is required"}
    assert client.get("/api/jobs/none").status_code == 404
