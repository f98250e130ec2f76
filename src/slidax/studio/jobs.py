"""Jobs: commands in processes of their own, with their state, log and results."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import shlex
import shutil
import time
from asyncio.subprocess import Process
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from slidax._errors import DefinitionError

from .commands import JobCommand, command_of
from .folder import Folder
from .process import ended, started

AT_ONCE, WAITING, KEPT = 2, 20, 100
"""Jobs that run, that wait, and that are remembered at most."""

LOG, ANSWER = 64_000, 8_000_000
"""Sizes of a job's log and answer for the page [bytes]."""

MEANING = {0: "done", 2: "refused", 3: "left its envelope", 4: "does not hold", 130: "interrupted"}
"""Meaning of exit codes; any other code means failure."""

INTERRUPTIBLE = ("study",)
"""Jobs that save their results on interruption."""

ROWS = re.compile(r"(\d+) of (\d+) rows")

State = Literal["waiting", "running", "done", "failed", "cancelled"]


class TooManyError(DefinitionError):
    """Too many jobs wait."""


@dataclass(eq=False)
class Job:
    """A command that waits, runs or has ended.

    - `name`: identifier for the page.
    - `kind`: key of `COMMANDS`.
    - `private`: its own folder, with its output.
    - `state`, `code`: state, and exit code of its process.
    - `key`: secret part of the address of its results.
    - `command`, `begun`, `seconds`, `process`, `task`: command, start, duration [s], process and task.
    """

    name: str
    kind: str
    command: JobCommand
    private: Path
    state: State = "waiting"
    code: int | None = None
    begun: float = 0.0
    seconds: float = 0.0
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    process: Process | None = None
    task: asyncio.Task[None] | None = None

    @property
    def over(self) -> bool:
        """True if the job has ended or was cancelled."""
        return self.state not in ("waiting", "running")


class Jobs:
    """The jobs of a server.

    - `folder`: of the studio.
    - `private`: the server's own folder.
    - `module`: has the command line; a job calls its `main`.
    """

    def __init__(self, folder: Folder, private: Path, module: str) -> None:
        self._folder, self._private, self._module = folder, private, module
        self._jobs: dict[str, Job] = {}
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._closed = False

    def add(self, kind: str, options: Mapping[str, Any]) -> Job:
        """Queue a new job of a `kind` with `options` from the page.

        Raises DefinitionError for invalid options, FileExistsError if results would be overwritten, TooManyError if too
        many jobs wait.
        """
        if self._closed:
            raise TooManyError("the studio is shutting down")
        if sum(not job.over for job in self._jobs.values()) >= AT_ONCE + WAITING:
            raise TooManyError("too many waiting jobs: wait, or cancel some")
        command = command_of(self._folder, kind, options)
        if any(not job.over and command.out and job.command.out == command.out for job in self._jobs.values()):
            raise FileExistsError(f"another job writes `{command.out}` already")
        name = secrets.token_hex(6)
        job = Job(name, kind, command, self._private / f"job-{name}")
        self._jobs[name] = job
        self._forget()
        job.task = asyncio.get_running_loop().create_task(self._run(job))
        return job

    def find(self, name: str) -> Job:
        """The job called `name`; raise LookupError if there is none."""
        return self._jobs[name]

    def of_key(self, key: str) -> Job:
        """The job whose results have the key `key`; raise LookupError if there is none."""
        for job in self._jobs.values():
            if secrets.compare_digest(job.key.encode(), key.encode("utf-8", "replace")):
                return job
        raise LookupError(key)

    def all(self) -> list[dict[str, Any]]:
        """All jobs, the newest first, without logs and answers."""
        return [self.shown(job, whole=False) for job in reversed(self._jobs.values())]

    def shown(self, job: Job, *, whole: bool = True) -> dict[str, Any]:
        """A `job` as the page shows it; `whole` includes its log and answer."""
        log = _tail(job.private / "log", LOG)
        rows = ROWS.findall(log)
        seconds = time.monotonic() - job.begun if job.state == "running" else job.seconds
        summary: dict[str, Any] = {
            "id": job.name,
            "kind": job.kind,
            "command": shlex.join(["slidax", *job.command.words]),
            "state": job.state,
            "code": job.code,
            "meaning": MEANING.get(job.code, "failed") if job.code is not None else "",
            "seconds": round(seconds, 2),
            "rows": [int(count) for count in rows[-1]] if rows else None,
            "out": job.command.out,
        }
        if whole:
            summary |= {"log": log, "answer": self._answer(job), "links": self._links(job) if job.over else []}
        return summary

    async def cancel(self, job: Job) -> None:
        """End a `job` and its process, or forget a job that has ended."""
        if job.over:
            self._jobs.pop(job.name, None)
            shutil.rmtree(job.private, ignore_errors=True)
            return
        job.state = "cancelled"
        if job.process is not None:
            await ended(job.process)
        elif job.task is not None:
            job.task.cancel()
        if job.task is not None:
            with suppress(asyncio.CancelledError):
                await job.task

    async def close(self) -> None:
        """End all jobs and accept no more."""
        self._closed = True
        unfinished = [job for job in self._jobs.values() if not job.over]
        await asyncio.gather(*(self.cancel(job) for job in unfinished), return_exceptions=True)

    async def _run(self, job: Job) -> None:
        async with self._turn:
            if job.over:
                return
            job.state, job.begun = "running", time.monotonic()
            command = job.command
            words = {
                "files": command.files,
                "changes": command.changes,
                "module": self._module,
                "words": command.words,
                "interruptible": job.kind in INTERRUPTIBLE,
            }
            job.private.mkdir(mode=0o700)
            try:
                with (job.private / "out").open("wb") as out, (job.private / "log").open("wb") as log:
                    job.process = await started(
                        self._folder.root,
                        job.private,
                        "slidax.studio.job",
                        [json.dumps(words)],
                        out=out,
                        errors=log,
                        calm=True,
                    )
                    if job.over:
                        await ended(job.process, gently=False)
                    job.code = await job.process.wait()
                # End child processes that still run, too.
                await ended(job.process, gently=False)
            except OSError as error:
                (job.private / "log").write_text(f"slidax: cannot start the job: {error}\n", encoding="utf-8")
            job.seconds = time.monotonic() - job.begun
            if not job.over:
                job.state = "done" if job.code in (0, 3, 4) else "failed"

    def _answer(self, job: Job) -> Any:
        text = _tail(job.private / "out", ANSWER)
        if not job.command.json or not job.over:
            return text[-LOG:]
        try:
            return json.loads(text)
        except ValueError:
            return text[-LOG:]

    def _links(self, job: Job) -> list[dict[str, str]]:
        """Files that a job has written, with their addresses."""
        out = job.command.out
        if not out:
            return []
        try:
            place = self._folder.place(out)
            names = [entry.name for entry in self._folder.listing(out)] if place.is_dir() else [out] * place.is_file()
        except DefinitionError:
            return []
        first = sorted(names, key=lambda name: (not name.endswith("report.html"), name.count("/"), name))
        return [{"name": name, "at": f"/results/{job.key}/{name}"} for name in first[:60]]

    def _forget(self) -> None:
        for job in [job for job in self._jobs.values() if job.over][: max(0, len(self._jobs) - KEPT)]:
            self._jobs.pop(job.name)
            shutil.rmtree(job.private, ignore_errors=True)


def _tail(path: Path, most: int) -> str:
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - most))
            return file.read(most).decode("utf-8", "replace")
    except OSError:
        return ""
