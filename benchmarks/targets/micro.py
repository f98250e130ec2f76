"""Cortex-M and RISC-V: the exported project, built by its Makefile and run in emulators."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import jax

from benchmarks.targets import Row
from slidax.export.golden_samples import BAD, OF_A_RUN, RANDOM
from slidax.export.micro import export_micro
from slidax.scenarios import load

SAMPLES = OF_A_RUN + RANDOM + BAD


@dataclass(frozen=True)
class Target:
    """One row.

    - `words`: what it is called.
    - `name`: in the Makefile.
    - `single`: floats in place of doubles.
    - `scenario`: whose law.
    - `compiler`, `size`, `emulator`: programs.
    """

    words: str
    name: str
    single: bool
    scenario: str
    compiler: str
    size: str
    emulator: str


ARM = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
BARE = ("riscv64-unknown-elf-gcc", "riscv64-unknown-elf-size", "qemu-system-riscv64")
LINUX = ("riscv64-linux-gnu-gcc", "riscv64-linux-gnu-size", "qemu-riscv64")
PACKAGES = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
    "riscv64-unknown-elf-gcc": "gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf",
    "qemu-system-riscv64": "qemu-system-misc",
    "riscv64-linux-gnu-gcc": "gcc-riscv64-linux-gnu libc6-dev-riscv64-cross",
    "qemu-riscv64": "qemu-user",
    "make": "make",
}
TARGETS = (
    Target("Cortex-M4F, float, two-link arm", "m4f", True, "example-4.1-1khz", *ARM),
    Target("Cortex-M7, double, two-link arm", "m7", False, "example-4.1-1khz", *ARM),
    Target("Cortex-M4F, float, Panda", "m4f", True, "panda-payload", *ARM),
    Target("Cortex-M7, float, Panda", "m7", True, "panda-payload", *ARM),
    Target("Cortex-M7, double, Panda", "m7", False, "panda-payload", *ARM),
    Target("RISC-V rv64gc, double, Panda", "rv64", False, "panda-payload", *BARE),
    Target("RISC-V Linux, double, Panda", "linux", False, "panda-payload", *LINUX),
)


def rows(folder: Path) -> list[Row]:
    """The rows of the table.

    - `folder`: to work in.
    """
    jax.config.update("jax_enable_x64", True)
    table = []
    for target in TARGETS:
        missing = [PACKAGES[each] for each in ("make", target.compiler, target.emulator) if not shutil.which(each)]
        if missing:
            table.append(Row(target.words, missing=", ".join(missing)))
            continue
        project = folder / f"{target.scenario}-{'float' if target.single else 'double'}"
        if not project.exists():
            export_micro(load(target.scenario), project, name="law", single=target.single)
        table.append(_measured(target, project))
    return table


def _measured(target: Target, project: Path) -> Row:
    done = subprocess.run(
        ["make", "-s", f"test-{target.name}"], cwd=project, capture_output=True, text=True, check=False
    )
    golden = re.search(r"golden samples: (\d+) of (\d+)", done.stdout)
    stack = re.search(r"stack: (\d+) bytes", done.stdout)
    steps = re.search(r"a step: (\d+) (\w+) on average, (\d+) at most", done.stdout)
    words = f"{int(steps[1]):,} {steps[2]}, at most {int(steps[3]):,}" if steps else ""
    if golden and int(golden[2]) < SAMPLES:
        words += f"; of {SAMPLES} samples, those that floats can be held to"
    return Row(
        target.words,
        compiled_by=f"{target.compiler} {_version(target.compiler)} -O2",
        run_by=f"{target.emulator} {_version(target.emulator)}",
        passed=int(golden[1]) if golden else 0,
        samples=int(golden[2]) if golden else SAMPLES,
        code=_text(target.size, project / target.name / "law.o"),
        stack=int(stack[1]) if stack else None,
        step=words,
    )


def _version(program: str) -> str:
    text = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
    numbers = re.findall(r"\d+\.\d+(?:\.\d+)?", text)
    return numbers[0] if numbers else ""


def _text(size: str, file: Path) -> int:
    """Code with its tables."""
    done = subprocess.run([size, file], capture_output=True, text=True, check=True)
    return int(done.stdout.splitlines()[1].split()[0])
