"""Confined processes of the studio, started and ended by the server."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from asyncio.subprocess import Process
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

PATIENCE = 2.0
"""Time for a process to end by itself [s]."""

LINE = 16_000_000
"""Size of a line in an answer at most [bytes]."""

KEPT = (
    *("PATH", "PYTHONPATH", "VIRTUAL_ENV", "LANG", "LC_ALL"),
    *("HOME", "XDG_CACHE_HOME", "USERPROFILE", "LOCALAPPDATA", "SYSTEMROOT"),
    *("JAX_PLATFORMS", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS"),
)
"""Environment variables of a job; others, such as keys, are withheld."""


def scratch() -> Path:
    """A new private folder for the server's processes."""
    return Path(tempfile.mkdtemp(prefix="slidax-studio-")).resolve()


async def started(
    root: Path, private: Path, module: str, words: Sequence[str], *, out: int | IO[bytes], errors: IO[bytes], calm: bool
) -> Process:
    """Start a process that cannot leave the studio's folder and ends when its standard input does.

    - `root`: the folder.
    - `private`: a folder for this process, created if missing.
    - `module`, `words`: `main` of the module is called with these arguments.
    - `out`, `errors`: for its output.
    - `calm`: run at lower priority.
    """
    private.mkdir(mode=0o700, parents=True, exist_ok=True)
    command = [sys.executable, "-P", "-m", "slidax.studio.confined", str(root), str(private), module, *words]
    if calm and shutil.which("nice"):
        command = ["nice", "-n", "5", *command]
    environment = {name: os.environ[name] for name in KEPT if name in os.environ}
    return await asyncio.create_subprocess_exec(
        *command,
        stdin=subprocess.PIPE,
        stdout=out,
        stderr=errors,
        env=environment | {"PYTHONUNBUFFERED": "1", "NO_COLOR": "1", "COLUMNS": "120", "MPLBACKEND": "agg"},
        start_new_session=True,
        limit=LINE,
    )


async def ended(process: Process, *, gently: bool = True) -> None:
    """End a `process` and its children; `gently` interrupts it first, as Ctrl-C does."""
    if process.returncode is None and gently:
        _send(process, signal.SIGINT)
        with suppress(TimeoutError):
            await asyncio.wait_for(process.wait(), PATIENCE)
    # Its children are of its group, also those that outlived it.
    _send(process, getattr(signal, "SIGKILL", signal.SIGTERM))
    if process.returncode is None:
        await process.wait()
    if process.stdin is not None:
        process.stdin.close()


def _send(process: Process, what: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        if sys.platform != "win32":
            os.killpg(process.pid, what)
        elif process.returncode is None:
            process.kill()
