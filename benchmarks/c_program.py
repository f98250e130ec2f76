"""The hand-written C loop, compiled and run."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_name("example_4_1.c")


def compiled(folder: Path) -> Path:
    """Compile the program, and return it.

    - `folder`: where the program goes.
    """
    program = folder / SOURCE.stem
    subprocess.run(["gcc", "-O3", "-o", str(program), str(SOURCE), "-lm"], check=True)
    return program


def nanoseconds_per_step(program: Path, mode: str, steps: int, period: float, repeats: int = 3) -> float:
    """Return the least time per step over a few repeats.

    - `program`: from `compiled`.
    - `mode`: "held" or "continuous".
    - `steps`, `period`: length of the run and time between samples [s].
    - `repeats`: number of runs inside the program.
    """
    arguments = [str(program), mode, str(steps), str(period), "1", str(repeats)]
    answer = subprocess.run(arguments, capture_output=True, text=True, check=True).stdout
    return float(json.loads(answer)["ns_per_step"]["min"])
