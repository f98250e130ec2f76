"""Start and end of the server's confined processes, and questions to the workbench process."""

from __future__ import annotations

import asyncio
import json
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
from typing import IO, Any

from slidax.core.errors import DefinitionError

from .files import Folder

PATIENCE = 2.0
"""Time for an interrupted process to end before it is killed [s]."""

LINE = 16_000_000
"""Longest line of an answer [bytes]."""

KEPT = (
    *("PATH", "PYTHONPATH", "VIRTUAL_ENV", "LANG", "LC_ALL"),
    *("HOME", "XDG_CACHE_HOME", "USERPROFILE", "LOCALAPPDATA", "SYSTEMROOT"),
    *("JAX_PLATFORMS", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS"),
)
"""Environment variables that the processes receive; they do not get others, such as secrets."""


def scratch() -> Path:
    """Create and return a private temporary folder for the server's processes."""
    return Path(tempfile.mkdtemp(prefix="slidax-studio-")).resolve()


async def start_process(
    root: Path,
    private: Path,
    module: str,
    words: Sequence[str],
    *,
    out: int | IO[bytes],
    errors: IO[bytes],
    low_priority: bool,
) -> Process:
    """Start a process that can access only the studio's folder, and that ends when its standard input ends.

    - `root`: the studio's folder.
    - `private`: a folder for this process, created if missing.
    - `module`, `words`: module whose `main` is called, and its arguments.
    - `out`, `errors`: files or `subprocess.PIPE` for its standard output and standard error.
    - `low_priority`: True to run at lower priority.
    """
    private.mkdir(mode=0o700, parents=True, exist_ok=True)
    command = [sys.executable, "-P", "-m", "slidax.studio.confined", str(root), str(private), module, *words]
    if low_priority and shutil.which("nice"):
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


async def end_process(process: Process, *, gently: bool = True) -> None:
    """End a `process` and its children; `gently` interrupts it first, as Ctrl-C does."""
    if process.returncode is None and gently:
        _send(process, signal.SIGINT)
        with suppress(TimeoutError):
            await asyncio.wait_for(process.wait(), PATIENCE)
    # Children are in the same process group, even those that outlived the process.
    _send(process, getattr(signal, "SIGKILL", signal.SIGTERM))
    if process.returncode is None:
        await process.wait()
    if process.stdin is not None:
        process.stdin.close()


def _send(process: Process, number: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        if sys.platform != "win32":
            os.killpg(process.pid, number)
        elif process.returncode is None:
            process.kill()


LONGEST = 120.0
"""Default time limit of an answer [s]."""


class OvertakenError(DefinitionError):
    """A newer question from the same sender replaced this one."""


class Workbench:
    """Answers questions about scenarios with a process that keeps compiled code in memory.

    - `folder`: the studio's folder.
    - `private`: private folder of the process.
    - `longest`: time limit of an answer [s].
    """

    def __init__(self, folder: Folder, private: Path, *, longest: float = LONGEST) -> None:
        self._folder, self._private, self._longest = folder, private, longest
        self._process: Process | None = None
        self._turn = asyncio.Lock()
        self._newest: dict[str, int] = {}
        self._closed = False
        self.restarts = 0

    async def warm(self) -> None:
        """Start the process before the first question."""
        async with self._turn:
            if not self._closed:
                await self._ready()

    async def ask(self, question: dict[str, Any], *, only_newest: str = "") -> tuple[dict[str, Any], bytes]:
        """Return the answer to a question, a mapping, and its binary data.

        - `question`: as `Bench.answer` takes it.
        - `only_newest`: name of a sender. Of its waiting questions, only the newest is answered.

        Raises OvertakenError if the sender asked a newer question in the meantime.
        """
        number = self._newest[only_newest] = self._newest.get(only_newest, 0) + 1
        async with self._turn:
            if only_newest and self._newest[only_newest] != number:
                raise OvertakenError("replaced by a newer question")
            if self._closed:
                return {"error": {"where": "", "message": "the studio is shutting down"}}, b""
            process = await self._ready()
            try:
                return await asyncio.wait_for(self._exchange(process, question), self._longest)
            except (TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, OSError, ValueError) as error:
                await end_process(process, gently=False)
                took = isinstance(error, TimeoutError)
                reason = (
                    f"it took more than {self._longest:g} s" if took else f"the process ended ({process.returncode})"
                )
                return {"error": {"where": "", "message": f"Not computed: {reason}. Try again."}}, b""
            except asyncio.CancelledError:
                # Otherwise this answer would be taken for that of the next question.
                await end_process(process, gently=False)
                raise

    async def close(self) -> None:
        """End the process; pending questions get an error."""
        self._closed = True
        if self._process is not None:
            await end_process(self._process, gently=False)

    async def _exchange(self, process: Process, question: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(question).encode() + b"\n")
        await process.stdin.drain()
        line = await process.stdout.readuntil(b"\n")
        answer: dict[str, Any] = json.loads(line)
        content = await process.stdout.readexactly(int(answer.pop("bytes")))
        return answer, content

    async def _ready(self) -> Process:
        if self._process is not None and self._process.returncode is None:
            return self._process
        self.restarts += self._process is not None
        self._private.mkdir(mode=0o700, parents=True, exist_ok=True)
        with (self._private / "log").open("ab") as log:
            self._process = await start_process(
                self._folder.root,
                self._private,
                "slidax.studio.bench",
                [],
                out=subprocess.PIPE,
                errors=log,
                low_priority=False,
            )
        return self._process
