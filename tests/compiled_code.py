"""Keep the programs that XLA compiles in a test run for the next run, in pytest's cache folder."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from pathlib import Path

import jax

WEEK = 7 * 24 * 3600.0
"""Time for which a program is kept [s]."""


def open_own_folder(kept: Path) -> Path:
    """Return a folder for this process alone, with all kept programs.

    JAX writes its files without a lock, so that a process could read a file that another process is writing.

    - `kept`: the folder of the kept programs.
    """
    for left in kept.iterdir():
        if time.time() - left.stat().st_mtime > WEEK:
            # A folder belongs to a process that was killed.
            shutil.rmtree(left, ignore_errors=True) if left.is_dir() else left.unlink(missing_ok=True)
    own = Path(tempfile.mkdtemp(prefix="own-", dir=kept))
    for file in kept.glob("*-cache"):
        try:
            os.link(file, own / file.name)
        except OSError:
            shutil.copy2(file, own / file.name)
    jax.config.update("jax_compilation_cache_dir", str(own))
    # Most programs are small, and there are many of them.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return own


def keep_programs(own: Path) -> None:
    """Keep the programs in the folder of this process.

    - `own`: the folder that `open_own_folder` returned.
    """
    for file in own.glob("*-cache"):
        os.replace(file, own.parent / file.name)
    shutil.rmtree(own, ignore_errors=True)


def memory_maps() -> int:
    """Number of memory maps of this process; 0 if the system does not list them.

    Each compiled program takes several, and Linux allows a process 65 530.
    """
    maps = Path("/proc/self/maps")
    return maps.read_bytes().count(b"\n") if maps.exists() else 0
