import json
import signal
import socket
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("uvicorn", reason="the extra `studio` is not installed")
if not sys.platform.startswith("linux"):
    pytest.skip("processes are looked at by /proc", allow_module_level=True)

from slidax.core.errors import DefinitionError
from slidax.studio.server import serve

from .running import Running, gone


@pytest.fixture
def running(tmp_path):
    root = tmp_path / "root"
    root.mkdir()
    server = Running(root)
    yield server
    server.end(signal.SIGKILL)


def test_the_server_listens_on_loopback_alone_and_ends_with_its_jobs(running):
    inodes = {link.readlink().name for link in Path(f"/proc/{running.process.pid}/fd").iterdir() if _is_socket(link)}
    listening = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in inodes:
                listening.append(words[1].rsplit(":", 1))
    assert {address for address, _ in listening} <= {"0100007F", "00000000000000000000000001000000"}
    assert {int(port, 16) for _, port in listening} == {running.port}
    # This is a name that an attacker's server resolves to this machine.
    assert running.ask("GET", "/", host=f"evil.example:{running.port}")[0] == 403
    assert running.ask("POST", "/api/check", {"name": "example-4.1"}, origin="http://evil.example")[0] == 403
    assert running.ask("GET", "/api/about")[0] == 200

    status, body = running.ask("POST", "/api/jobs", {"kind": "certify", "options": {"scenario": "panda-payload"}})
    assert status == 201
    until = time.monotonic() + 20
    while json.loads(running.ask("GET", f"/api/jobs/{json.loads(body)['id']}")[1])["state"] == "waiting":
        assert time.monotonic() < until
    children = running.children()
    assert len(children) >= 2
    # A waiting client gets an answer, and the server does not wait for its result.
    waiting = threading.Thread(target=running.ask, args=("POST", "/api/compiled", {"name": "panda-payload"}))
    waiting.start()
    time.sleep(1.0)
    assert running.end(signal.SIGINT, 5.0) == 0
    waiting.join(5.0)
    assert not waiting.is_alive() and gone(children)
    assert "Traceback" not in running.output and "ERROR" not in running.output
    assert not list(Path("/tmp").glob(f"slidax-studio-*/job-{json.loads(body)['id']}"))


@pytest.mark.full
def test_a_killed_server_ends_its_processes(running):
    running.ask("POST", "/api/jobs", {"kind": "certify", "options": {"scenario": "panda-payload"}})
    until = time.monotonic() + 20
    while len(running.children()) < 2:
        assert time.monotonic() < until
        time.sleep(0.05)
    time.sleep(1.5)
    children = running.children()
    running.end(signal.SIGKILL)
    assert gone(children)


def test_a_port_in_use_is_reported_with_the_remedy(tmp_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(DefinitionError, match=r"port \d+ cannot be used.*--port 0"):
            serve(tmp_path, module="slidax.cli", port=other.getsockname()[1], browser=False)


def _is_socket(link):
    try:
        return link.readlink().name.startswith("socket:")
    except OSError:
        return False
