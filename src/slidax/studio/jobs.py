"""Long things, each in a process of its own: what waits, what runs, what came of it."""

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

from .commands import Asked, command_of
from .folder import Folder
from .process import ended, started

AT_ONCE, WAITING, KEPT = 2, 20, 100
"""Jobs that run, that may wait, and that are remembered."""

LOG, ANSWER = 64_000, 8_000_000
"""Bytes of a job's log, and of its answer, that the page gets."""

MEANING = {0: "done", 2: "refused", 3: "left its envelope", 4: "does not hold", 130: "interrupted"}
"""Of the exit codes of a command; a command that ends with another one has failed."""

INTERRUPTIBLE = ("study",)
"""Jobs that keep what they have when they are interrupted."""

ROWS = re.compile(r"(\d+) of (\d+) rows")

State = Literal["waiting", "running", "done", "failed", "cancelled"]


class TooManyError(DefinitionError):
    """As many jobs wait as may."""


@dataclass(eq=False)
class Job:
    """A command that waits, runs or has run.

    - `name`: by which the page asks for it.
    - `kind`: of `COMMANDS`.
    - `asked`: its command.
    - `private`: its own folder, with what it prints.
    - `state`, `code`: how it is, and the exit code of its process.
    - `key`: under which its results are shown; nobody can guess it.
    """

    name: str
    kind: str
    asked: Asked
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
        """Whether it has ended, or never will begin."""
        return self.state not in ("waiting", "running")


class Jobs:
    """The jobs of a server.

    - `folder`: of the studio.
    - `private`: the server's own folder.
    - `module`: with the command line, whose `main` a job calls.
    """

    def __init__(self, folder: Folder, private: Path, module: str) -> None:
        self._folder, self._private, self._module = folder, private, module
        self._jobs: dict[str, Job] = {}
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._closed = False

    def add(self, kind: str, said: Mapping[str, Any]) -> Job:
        """A new job, which runs when it is its turn.

        - `kind`: of the command.
        - `said`: to it, by the page.

        Raises DefinitionError if it is none, FileExistsError if results would be written over, TooManyError if too many
        wait.
        """
        if self._closed:
            raise TooManyError("the studio ends")
        if sum(not job.over for job in self._jobs.values()) >= AT_ONCE + WAITING:
            raise TooManyError("too many jobs wait: let some end, or cancel them")
        asked = command_of(self._folder, kind, said)
        if any(not job.over and asked.out and job.asked.out == asked.out for job in self._jobs.values()):
            raise FileExistsError(f"another job writes `{asked.out}`")
        name = secrets.token_hex(6)
        job = Job(name, kind, asked, self._private / f"job-{name}")
        self._jobs[name] = job
        self._forget()
        job.task = asyncio.get_running_loop().create_task(self._run(job))
        return job

    def find(self, name: str) -> Job:
        """A job by its name.

        - `name`: that was given to it.

        Raises LookupError if there is none.
        """
        return self._jobs[name]

    def of_key(self, key: str) -> Job:
        """The job whose results are shown under a key.

        - `key`: of it.

        Raises LookupError if there is none.
        """
        for job in self._jobs.values():
            if secrets.compare_digest(job.key.encode(), key.encode("utf-8", "replace")):
                return job
        raise LookupError(key)

    def all(self) -> list[dict[str, Any]]:
        """All jobs, the last first, without their logs and answers."""
        return [self.shown(job, whole=False) for job in reversed(self._jobs.values())]

    def shown(self, job: Job, *, whole: bool = True) -> dict[str, Any]:
        """What the page gets of a job.

        - `job`: any.
        - `whole`: whether with its log, and with its answer.
        """
        log = _tail(job.private / "log", LOG)
        rows = ROWS.findall(log)
        seconds = time.monotonic() - job.begun if job.state == "running" else job.seconds
        found: dict[str, Any] = {
            "id": job.name,
            "kind": job.kind,
            "command": shlex.join(["slidax", *job.asked.words]),
            "state": job.state,
            "code": job.code,
            "meaning": MEANING.get(job.code, "failed") if job.code is not None else "",
            "seconds": round(seconds, 2),
            "rows": [int(one) for one in rows[-1]] if rows else None,
            "out": job.asked.out,
        }
        if whole:
            found |= {"log": log, "answer": self._answer(job), "links": self._links(job) if job.over else []}
        return found

    async def cancel(self, job: Job) -> None:
        """Ends a job and its process; one that is over is forgotten.

        - `job`: any.
        """
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
        """Ends all jobs, and takes no more."""
        self._closed = True
        open_ones = [job for job in self._jobs.values() if not job.over]
        await asyncio.gather(*(self.cancel(job) for job in open_ones), return_exceptions=True)

    async def _run(self, job: Job) -> None:
        async with self._turn:
            if job.over:
                return
            job.state, job.begun = "running", time.monotonic()
            asked = job.asked
            words = {
                "files": asked.files,
                "changes": asked.changes,
                "module": self._module,
                "words": asked.words,
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
                # What it has started may still run: it goes, too.
                await ended(job.process, gently=False)
            except OSError as error:
                (job.private / "log").write_text(f"slidax: the job did not start: {error}\n", encoding="utf-8")
            job.seconds = time.monotonic() - job.begun
            if not job.over:
                job.state = "done" if job.code in (0, 3, 4) else "failed"

    def _answer(self, job: Job) -> Any:
        text = _tail(job.private / "out", ANSWER)
        if not job.asked.json or not job.over:
            return text[-LOG:]
        try:
            return json.loads(text)
        except ValueError:
            return text[-LOG:]

    def _links(self, job: Job) -> list[dict[str, str]]:
        """What a job has written: files by name, and where they are shown."""
        out = job.asked.out
        if not out:
            return []
        try:
            place = self._folder.place(out)
            names = [one.name for one in self._folder.listing(out)] if place.is_dir() else [out] * place.is_file()
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
