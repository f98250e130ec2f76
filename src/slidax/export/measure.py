"""Size of an exported step on this machine: lines, code size from the compiler, and instructions from valgrind."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .c_project import CProject

STEPS = 200, 700
"""Steps of two closed-loop runs; the difference of their instruction counts is the cost of the additional steps."""


class StepSize(NamedTuple):
    """The size of an exported step in C.

    - `lines`: lines of its source file.
    - `code`: code and constants, compiled on this machine with `-O2` [bytes]; None without a compiler.
    - `instructions`: average number of instructions per step of the closed loop; None without valgrind.
    """

    lines: int
    code: int | None
    instructions: int | None

    def __str__(self) -> str:
        parts = [f"{self.lines} lines"]
        if self.code is not None:
            parts.append(f"{self.code} bytes of code by this machine's cc -O2")
        if self.instructions is not None:
            parts.append(f"{self.instructions} instructions a step on average")
        return ", ".join(parts)


def measure_step(exported: CProject, folder: str | Path) -> StepSize:
    """Measure the step of a C project; sizes whose tool is missing on this machine are None.

    - `exported`: the exported law, as `export_c` returns it.
    - `folder`: folder of the project, with its tests.
    """
    folder = Path(folder)
    source = folder / f"{exported.prefix}.c"
    lines = len(source.read_text(encoding="utf-8").splitlines())
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return StepSize(lines, None, None)
    with tempfile.TemporaryDirectory() as place:
        base = [compiler, "-std=c99", "-O2", "-ffp-contract=off"]
        _run([*base, "-c", str(source), "-o", f"{place}/law.o"])
        code = _code(f"{place}/law.o")
        instructions = None
        if shutil.which("valgrind"):
            files = [str(folder / name) for name in (source.name, f"{exported.prefix}_scenario.c", "latency.c")]
            built = _run([*base, "-fno-inline-functions-called-once", *files, "-o", f"{place}/latency", "-lm"])
            instructions = None if built is None else _instructions(exported.prefix, place)
        return StepSize(lines, code, instructions)


def _code(file: str) -> int | None:
    table = _run(["size", file]) if shutil.which("size") else None
    return None if table is None else int(table.splitlines()[1].split()[0])


def _instructions(prefix: str, place: str) -> int | None:
    profiler = ["valgrind", "--tool=callgrind", f"--toggle-collect={prefix}_step", f"--callgrind-out-file={place}/out"]
    counted = []
    for steps in STEPS:
        output = _run([*profiler, f"{place}/latency", str(steps), f"{place}/latency.svg"])
        match = re.search(r"Collected : (\d+)", output or "")
        if match is None:
            return None
        counted.append(int(match.group(1)))
    return round((counted[1] - counted[0]) / (STEPS[1] - STEPS[0]))


def _run(command: list[str]) -> str | None:
    """Return the output and error output of a command; None if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout + done.stderr if done.returncode == 0 else None
