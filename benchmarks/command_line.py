"""From typing a command to its answer."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

SLIDAX = Path(sys.executable).with_name("slidax")


def measure() -> dict[str, Any]:
    """Seconds of wall time: cold (nothing compiled yet) and warm (the compilation cache filled), least and median."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"XDG_CACHE_HOME": cache}
        # Python keeps its own compiled files, as it does for a user.
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        helped = [_seconds(["--help"], environment) for _ in range(5)]
        times = {"slidax --help": {"min": min(helped), "median": statistics.median(helped)}}
        for engine in ("native", "xla"):
            command = ["run", "example-4.1", "--engine", engine, "--json"]
            cold = _seconds(command, environment)
            warm = [_seconds(command, environment) for _ in range(8)]
            times[f"slidax {' '.join(command)}, nothing compiled yet"] = {"min": cold, "median": cold}
            times[f"the same by {engine}, once more"] = {"min": min(warm), "median": statistics.median(warm)}
    return times


def _seconds(arguments: list[str], environment: dict[str, str]) -> float:
    started = time.perf_counter()
    subprocess.run([str(SLIDAX), *arguments], env=environment, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - started


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
