"""On what the times were taken."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path


def describe() -> str:
    """One line: processor, cores, system, compiler and the versions that matter."""
    gcc = subprocess.run(["gcc", "-dumpfullversion"], capture_output=True, text=True, check=False).stdout.strip()
    packages = ", ".join(f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy", "equinox"))
    return (
        f"{_processor()}, {os.cpu_count()} cores; {platform.system()} {platform.machine()}; "
        f"Python {platform.python_version()}, {packages}; gcc {gcc or 'not found'}"
    )


def well_made_from_the_start() -> None:
    """No code that was only made quickly: a speed that is measured is that of many runs."""
    from slidax.codegen.llvm import kernel

    kernel.WORTHWHILE_ITERATIONS.update(dict.fromkeys(kernel.WORTHWHILE_ITERATIONS, 0))


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unnamed processor"
