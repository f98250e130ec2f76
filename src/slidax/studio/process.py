"""Confined processes of the studio, as the server starts and ends them."""

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
"""Seconds that a process has to end when asked to."""

LINE = 16_000_000
"""Bytes of a line that it may answer with."""

KEPT = (
    *("PATH", "PYTHONPATH", "VIRTUAL_ENV", "LANG", "LC_ALL"),
    *("HOME", "XDG_CACHE_HOME", "USERPROFILE", "LOCALAPPDATA", "SYSTEMROOT"),
    *("JAX_PLATFORMS", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS"),
)
"""Of the environment; what else is in it, such as keys, is no business of a job's."""


def scratch() -> Path:
    """A new folder of the server's processes, for its owner alone."""
    return Path(tempfile.mkdtemp(prefix="slidax-studio-")).resolve()


async def started(
    root: Path, private: Path, module: str, words: Sequence[str], *, out: int | IO[bytes], errors: IO[bytes], calm: bool
) -> Process:
    """A process that cannot leave the studio's folder; it ends when its standard input does.

    - `root`: the folder.
    - `private`: a folder of this process, which is made.
    - `module`: whose `main` it calls.
    - `words`: arguments.
    - `out`, `errors`: where it prints.
    - `calm`: whether it gives way to others.
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
    """Ends a process and all that it has started.

    - `process`: any; one that has ended stays so.
    - `gently`: whether it is interrupted first, as by Ctrl-C.
    """
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
