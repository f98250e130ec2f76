"""The software and the machine that made a report."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from slidax import __version__

PACKAGES = ("jax", "jaxlib", "equinox", "numpy", "matplotlib")


def versions() -> dict[str, str]:
    """The version of each package that computes or draws, by name."""
    return {"slidax": __version__, "Python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def machine() -> dict[str, str]:
    """The machine: processor, number of cores, system."""
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count() or "unknown"),
        "system": f"{platform.system()} on {platform.machine()}",
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
