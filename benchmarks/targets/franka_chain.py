"""The exported program on franka-sim: its server on loopback, the program as a process of its own."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax.numpy as jnp

from slidax.scenarios import Scenario

from .mjcf import mjcf

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PORT = 1337
"""libfranka knows no other."""

FAULTS = ("none", "one-nan", "nan", "pause", "gravity")


def python() -> Path | None:
    """The Python with franka-sim and pylibfranka: $SLIDAX_FRANKA_PYTHON, or `.venv-franka` here; None without."""
    path = Path(os.environ.get("SLIDAX_FRANKA_PYTHON", ROOT / ".venv-franka" / "bin" / "python"))
    return path if path.is_file() else None


def missing() -> str:
    """Programs that this machine lacks; "" if none."""
    if python() is None:
        return "franka-sim and pylibfranka, in an environment .venv-franka of Python 3.12 (docs/targets.md)"
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", PORT))
        except OSError:
            return f"port {PORT}, which somebody else has"
    return ""


@contextmanager
def serving(scenario: Scenario, folder: Path, *arguments: str) -> Iterator[None]:
    """franka-sim with the scenario's true arm: lighter than the law believes, with its load and friction.

    - `scenario`: whose arm.
    - `folder`: for its files.
    - `arguments`: of franka_server.py.

    Raises RuntimeError if it does not start.
    """
    model, log = folder / "arm.xml", folder / "server.log"
    arm = scenario.plant.at(jnp.zeros(()))
    model.write_text(mjcf(arm), encoding="utf-8")
    with log.open("w") as file:
        server = subprocess.Popen(
            [str(python()), str(HERE / "franka_server.py"), *arguments],
            env={**os.environ, "FR3_MJCF": str(model), "PYTHONPATH": ""},
            stdout=file,
            stderr=subprocess.STDOUT,
        )
    try:
        for _ in range(300):
            if "Server listening" in log.read_text():
                break
            if server.poll() is not None:
                break
            time.sleep(0.1)
        else:
            raise RuntimeError(f"franka-sim does not answer: {log.read_text()[-500:]}")
        if server.poll() is not None:
            raise RuntimeError(f"franka-sim ended: {log.read_text()[-500:]}")
        time.sleep(1.0)
        yield
    finally:
        server.terminate()
        try:
            server.wait(timeout=20)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()


def moved_in_time(folder: Path, fault: str, attempts: int = 3) -> dict[str, Any]:
    """As `moved`, again where the machine itself was late by 20 ms, which is the robot's reflex and no matter of ours.

    - `folder`: with the exported program.
    - `fault`: of `FAULTS`.
    - `attempts`: largest number; the result has the actual one.
    """
    for attempt in range(1, attempts + 1):
        result = moved(folder, fault) | {"attempts": attempt}
        late = "communication_constraints_violation" in result["outcome"] and fault != "pause"
        if not late:
            break
    return result


def moved(folder: Path, fault: str) -> dict[str, Any]:
    """Run one motion, and return its report.

    - `folder`: with the exported program.
    - `fault`: of `FAULTS`.
    """
    done = subprocess.run(
        [str(python()), str(HERE / "franka_faults.py"), str(folder), fault],
        env={**os.environ, "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr[-2000:])
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result
