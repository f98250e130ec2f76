"""A studio as a user starts it: a process of its own, by the command line."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

COMMAND = [sys.executable, "-c", "from slidax.cli import main; main()", "studio", "--no-browser", "--port", "0"]


class Running:
    """A studio in the folder `root`, with its log."""

    def __init__(self, root, *words):
        self.log = root.parent / "studio.log"
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        with self.log.open("wb") as log:
            self.process = subprocess.Popen([*COMMAND, *words], cwd=root, stdout=log, stderr=log, env=environment)
        until = time.monotonic() + 60
        result = None
        while result is None:
            assert self.process.poll() is None and time.monotonic() < until, self.output
            time.sleep(0.05)
            result = re.search(r"http://127\.0\.0\.1:(\d+)/#token=([\w-]+)", self.output)
        self.address, self.port, self.token = result[0], int(result[1]), result[2]

    @property
    def output(self):
        return self.log.read_text(encoding="utf-8", errors="replace")

    def ask(self, method, path, value=None, **headers):
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=130)
        fields = {"x-slidax-token": self.token, "content-type": "application/json"} | {
            name.replace("_", "-"): item for name, item in headers.items()
        }
        try:
            link.request(method, path, None if value is None else json.dumps(value), fields)
            answer = link.getresponse()
            return answer.status, answer.read()
        finally:
            link.close()

    def children(self):
        result, new = [], [self.process.pid]
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
            result += new
        return result

    def end(self, how=signal.SIGINT, seconds=15.0):
        if self.process.poll() is None:
            self.process.send_signal(how)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise


def gone(processes, seconds=10.0):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if not any(_runs(item) for item in processes):
            return True
        time.sleep(0.05)
    return False


def _runs(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
