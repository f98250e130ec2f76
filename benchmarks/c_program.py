"""The hand-written C loops, compiled and run."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

HERE = Path(__file__).parent
FLAGS = ["-O3"]


def compiled(name: str, folder: Path) -> Path:
    """The program made from `benchmarks/<name>.c`.

    - `name`: of the source file, without its ending.
    - `folder`: where the program goes.
    """
    program = folder / name
    subprocess.run(["gcc", *FLAGS, "-o", str(program), str(HERE / f"{name}.c"), "-lm"], check=True)
    return program


def nanoseconds_per_step(program: Path, mode: str, steps: int, period: float, repeats: int = 3) -> float:
    """The least time per step over a few repeats.

    - `program`: from `compiled`.
    - `mode`: "held" or "continuous".
    - `steps`, `period`: length of the run and time between samples [s].
    - `repeats`: how often it is run inside the program.
    """
    arguments = [str(program), mode, str(steps), str(period), "1", str(repeats)]
    answer = subprocess.run(arguments, capture_output=True, text=True, check=True).stdout
    return float(json.loads(answer)["ns_per_step"]["min"])
