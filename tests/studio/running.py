"""A studio as a user starts it: a process of its own, by the command line."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

COMMAND = [sys.executable, "-c", "from slidax.cli import main; main()", "studio", "--no-browser", "--port", "0"]


class Running:
    """A studio, with what it says.

    - `root`: its folder.
    - `words`: more of its command.
    """

    def __init__(self, root: Path, *words: str) -> None:
        self.log = root.parent / "studio.log"
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        with self.log.open("wb") as log:
            self.process = subprocess.Popen([*COMMAND, *words], cwd=root, stdout=log, stderr=log, env=environment)
        until = time.monotonic() + 60
        found = None
        while found is None:
            assert self.process.poll() is None and time.monotonic() < until, self.said
            time.sleep(0.05)
            found = re.search(r"http://127\.0\.0\.1:(\d+)/#token=([\w-]+)", self.said)
        self.address, self.port, self.token = found[0], int(found[1]), found[2]

    @property
    def said(self) -> str:
        return self.log.read_text(encoding="utf-8", errors="replace")

    def ask(self, method: str, path: str, value: Any = None, **headers: str) -> tuple[int, bytes]:
        """A request as it stands, with the token: status and body."""
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=130)
        given = {"x-slidax-token": self.token, "content-type": "application/json"} | {
            name.replace("_", "-"): one for name, one in headers.items()
        }
        try:
            link.request(method, path, None if value is None else json.dumps(value), given)
            answer = link.getresponse()
            return answer.status, answer.read()
        finally:
            link.close()

    def children(self) -> list[int]:
        """All processes that come from it."""
        found, new = [], [self.process.pid]
        parents = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
                except OSError:
                    continue
                if state != "Z":
                    parents[int(entry.name)] = int(parent)
        while new:
            new = [child for child, parent in parents.items() if parent in new]
            found += new
        return found

    def end(self, how: int = signal.SIGINT, seconds: float = 15.0) -> int:
        """Ends it, and says its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise


def gone(processes: list[int], seconds: float = 10.0) -> bool:
    """Whether all these have ended, soon."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if not any(_runs(one) for one in processes):
            return True
        time.sleep(0.05)
    return False


def _runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
