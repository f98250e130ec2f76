"""The exported C step, from its own latency program. Run as `python -m benchmarks.exported_c`."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

SCENARIOS = ("example-4.1", "example-4.2", "example-4.1-1khz", "example-4.2-1khz")
REPEATS = 5
"""The least of each figure counts: what else the machine does is not the law's."""

FLAGS = ["-std=c99", "-O3", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic"]


def measure() -> dict[str, Any]:
    """Nanoseconds of a step by share of the steps, and how many lines the step has."""
    import jax

    jax.config.update("jax_enable_x64", True)
    from slidax import export, scenarios

    laws = {}
    for name in SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder)
            project = export.export_c(scenarios.load(name), out)
            sources = [out / f"{project.prefix}.c", out / f"{project.prefix}_scenario.c", out / "latency.c"]
            program = out / "latency"
            subprocess.run(["gcc", *FLAGS, "-o", program, *sources, "-lm"], check=True, cwd=out)
            outputs = [
                subprocess.run([program], check=True, cwd=out, capture_output=True, text=True).stdout
                for _ in range(REPEATS)
            ]
            lines = len(sources[0].read_text(encoding="utf-8").splitlines())
        times: dict[str, float] = {}
        for share, ns in re.findall(r"^(p50|p99|p99\.9|max)\s+(\d+) ns", "\n".join(outputs), re.MULTILINE):
            times[share] = min(float(ns), times.get(share, float(ns)))
        laws[name] = {"ns": times, "lines": lines}
    return laws


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
