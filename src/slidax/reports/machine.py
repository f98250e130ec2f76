"""Software versions and machine, for reports."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from slidax import __version__

PACKAGES = ("jax", "jaxlib", "equinox", "numpy", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of Python, slidax and the packages that compute or draw, by name."""
    return {"slidax": __version__, "Python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def machine() -> dict[str, str]:
    """Processor, number of cores and operating system."""
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
