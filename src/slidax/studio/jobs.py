"""Jobs: slidax commands in separate processes."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import shlex
import shutil
import time
from asyncio.subprocess import Process
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from slidax.core.errors import DefinitionError, nearest_word, plain_name

from .files import Folder, require_ending
from .processes import end_process, start_process

YAML = (".yaml", ".yml")
LOGS = (".csv", ".parquet", ".mcap", ".json", ".jsonl")
ROBOTS = (".urdf", ".xml", ".mjcf", *YAML)

WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,63}")
PATH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,199}")


@dataclass
class JobCommand:
    """The command of a job.

    - `words`: arguments after `slidax`.
    - `files`: files below the studio's folder that the command reads.
    - `changes`: changed values of a scenario, by path.
    - `out`: the file or folder with the result to show; empty for none.
    - `writes`: all files and folders that the command writes.
    - `replaces`: True if one of them exists already.
    - `json`: True if the command prints JSON.
    """

    words: list[str]
    files: list[str]
    changes: dict[str, Any]
    out: str = ""
    writes: list[str] = field(default_factory=list)
    replaces: bool = False
    json: bool = False


Reader = Callable[[JobCommand, Folder, Any, str], None]
"""Checks an option from the page and adds it to a command: `(command, folder, value, name)`."""


def _scenario(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    if text.lower().endswith(YAML):
        _file(YAML)(command, folder, value, name)
    else:
        command.words.append(_word(text, name))


def _file(endings: tuple[str, ...], option: bool = False) -> Reader:
    def read(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
        text = _text(value, name)
        require_ending(text, endings)
        if not folder.resolve(text).is_file():
            raise DefinitionError(f"file `{plain_name(text)}` does not exist", where=name)
        command.files.append(text)
        command.words.append(f"--{name}={text}" if option else text)

    return read


def _robot(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    if text.lower().endswith(".xacro"):
        raise DefinitionError("the studio does not expand xacro: run `xacro FILE > robot.urdf` first", where=name)
    if text.lower().endswith(ROBOTS):
        _file(ROBOTS, option=True)(command, folder, value, name)
    else:
        command.words.append(f"--{name}={_word(text, name)}")


def _finished(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    """Add the folder or .mcap file of a finished run."""
    text = _text(value, name)
    path = folder.resolve(text)
    if not (path.is_dir() or (path.is_file() and text.endswith(".mcap"))):
        raise DefinitionError(f"run `{plain_name(text)}` does not exist", where=name)
    if path.is_dir():
        command.files += [entry.name for entry in folder.listing(text) if entry.name.endswith(YAML)]
    command.words.append(text)


def _folder_out(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    command.replaces = not folder.is_free(text)
    command.out = text
    command.writes.append(text)
    command.words.append(f"--out={text}")


def _file_out(endings: tuple[str, ...]) -> Reader:
    def write(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
        text = _text(value, name)
        require_ending(text, endings)
        command.replaces = folder.resolve(text).exists()
        command.out = text
        command.writes.append(text)
        command.words.append(f"--out={text}")

    return write


def _report(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    replaces = command.replaces
    _folder_out(command, folder, value, name)
    command.words[-1] = f"--report={command.out}"
    command.replaces = command.replaces or replaces


def _number(low: float, high: float, kind: type[int] | type[float] = int) -> Reader:
    def read(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise DefinitionError(f"must be a number from {low:g} to {high:g}; got {plain_name(value)}", where=name)
        if kind is int and value != int(value):
            raise DefinitionError(f"must be an integer; got {plain_name(value)}", where=name)
        command.words.append(f"--{name}={kind(value)}")

    return read


def _flag(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    if not isinstance(value, bool):
        raise DefinitionError(f"must be true or false; got {plain_name(value)}", where=name)
    if value:
        command.words.append(f"--{name}")


def _named(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    words = [_word(word, name) for word in _text(value, name).split(",")]
    command.words.append(f"--{name}={','.join(words)}")


def _changes(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    if not isinstance(value, dict):
        raise DefinitionError("must be a mapping from paths to values", where=name)
    for path, content in value.items():
        if not PATH.fullmatch(path):
            raise DefinitionError(f"`{plain_name(path)}` is not the path of a field", where=name)
        command.changes[path] = content
        command.words.append(f"--set={path}={json.dumps(content, allow_nan=False)}")


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value:
        raise DefinitionError(f"must be text; got {plain_name(value)}", where=name)
    return value


def _word(value: str, name: str) -> str:
    if not WORD.fullmatch(value):
        raise DefinitionError(f"`{plain_name(value)}` is not a valid name", where=name)
    return value


SCENARIO: dict[str, Reader] = {"scenario": _scenario, "set": _changes}

COMMANDS: dict[str, tuple[tuple[str, ...], dict[str, Reader], bool]] = {
    "run": (("run",), SCENARIO | {"out": _folder_out}, True),
    "certify": (
        ("certify",),
        SCENARIO | {"out": _folder_out, "runs": _number(0, 100_000), "seed": _number(0, 2**31)},
        True,
    ),
    "compare": (("compare",), SCENARIO | {"out": _folder_out, "schemes": _named}, False),
    "explain": (("explain",), {"run": _finished}, True),
    "design": (
        ("design",),
        {"requirements": _file(YAML), "out": _file_out(YAML), "runs": _number(10, 100_000)},
        True,
    ),
    "excite": (
        ("excite",),
        {"robot": lambda command, folder, value, name: _positional(command, folder, value, name)}
        | {"out": _file_out((".csv",)), "seed": _number(0, 2**31)},
        False,
    ),
    "identify": (
        ("identify",),
        {"log": _file(LOGS), "robot": _robot, "out": _file_out(YAML), "report": _report, "links": _flag}
        | {"tip": _named, "held-out": _number(0.0, 0.9, float)},
        True,
    ),
    "study": (
        ("study", "--progress"),
        {"file": _file(YAML), "out": _folder_out, "runs": _number(1, 10_000_000), "seed": _number(0, 2**31)}
        | {"resume": _flag},
        True,
    ),
    "export-c": (("export", "c"), SCENARIO | {"out": _folder_out, "name": _named, "float": _flag}, False),
    "export-web": (("export", "web"), SCENARIO | {"with": _named, "out": _folder_out}, False),
}
"""By kind of job: the first words of its command, its options in order, and True if the command prints JSON."""

REQUIRED = ("scenario", "requirements", "robot", "log", "file", "run")
"""Options that are required in every command that has them."""

WRITING = ("design", "excite", "export-c", "export-web")
"""Commands that require `out`."""


def _positional(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    _robot(command, folder, value, name)
    command.words[-1] = command.words[-1].removeprefix(f"--{name}=")


def command_of(folder: Folder, job: str, options: Mapping[str, Any]) -> JobCommand:
    """Return the command of a job, with its options checked.

    - `folder`: the studio's folder.
    - `job`: kind of the job, a key in `COMMANDS`.
    - `options`: options from the page, by name; `replace` allows overwriting results.

    Raises DefinitionError for unknown or invalid options, OutsideError for a file outside the folder, and
    FileExistsError if results would be overwritten.
    """
    if job not in COMMANDS:
        raise DefinitionError(f"unknown job `{plain_name(job)}`; {nearest_word(str(job), COMMANDS)}")
    words, readers, prints_json = COMMANDS[job]
    command = JobCommand([*words, *(["--json"] if prints_json else [])], [], {}, json=prints_json)
    for name in options:
        if name not in readers and name != "replace":
            raise DefinitionError(f"unknown `{plain_name(name)}`; {nearest_word(str(name), readers)}", where=job)
    for name, reader in readers.items():
        if options.get(name) not in (None, ""):
            reader(command, folder, options[name], name)
        elif name in REQUIRED:
            raise DefinitionError("is required", where=name)
    if job in WRITING and not command.out:
        raise DefinitionError("is required: the file or folder to write", where="out")
    if command.replaces and options.get("replace") is not True and options.get("resume") is not True:
        raise FileExistsError(f"`{command.out}` already exists")
    return command


AT_ONCE, WAITING, KEPT = 2, 20, 100
"""Largest numbers of jobs that run at once, that wait, and that the studio remembers."""

LOG, ANSWER = 64_000, 8_000_000
"""Largest sizes of a job's log and of its answer on the page [bytes]; only the ends of longer ones are shown."""

MEANING = {0: "done", 2: "refused", 3: "left its envelope", 4: "does not hold", 130: "interrupted"}
"""Meaning of exit codes; any other code means failure."""

INTERRUPTIBLE = ("study",)
"""Jobs that save their results on interruption."""

ROWS = re.compile(r"(\d+) of (\d+) rows")

State = Literal["waiting", "running", "done", "failed", "cancelled"]


class TooManyError(DefinitionError):
    """A job is refused: too many jobs wait, or the studio is shutting down."""


@dataclass(eq=False)
class StudioJob:
    """A waiting, running or finished command.

    - `name`: identifier for the page.
    - `kind`: key in `COMMANDS`.
    - `command`: the command.
    - `private`: the job's private folder, with the files `out` and `log` of its output.
    - `state`, `code`: state of the job, and exit code of its process; None before its end.
    - `begun`, `seconds`: start and duration [s].
    - `key`: secret part of the address of the results.
    - `process`: the process of the command.
    - `task`: the asyncio task that starts the process and waits for it.
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

    - `folder`: the studio's folder.
    - `private`: the server's own folder, in which each job has a folder.
    - `module`: module of the command line; a job calls its `main`.
    """

    def __init__(self, folder: Folder, private: Path, module: str) -> None:
        self._folder, self._private, self._module = folder, private, module
        self._jobs: dict[str, StudioJob] = {}
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._closed = False

    def add(self, kind: str, options: Mapping[str, Any]) -> StudioJob:
        """Queue a new job and return it.

        - `kind`: key in `COMMANDS`.
        - `options`: options from the page, by name.

        Raises DefinitionError for invalid options or if another job writes the same `out`, FileExistsError if results
        would be overwritten, TooManyError if too many jobs wait.
        """
        if self._closed:
            raise TooManyError("the studio is shutting down")
        if sum(not job.over for job in self._jobs.values()) >= AT_ONCE + WAITING:
            raise TooManyError("too many waiting jobs: wait, or cancel some")
        command = command_of(self._folder, kind, options)
        for text in command.writes:
            if any(not job.over and text in job.command.writes for job in self._jobs.values()):
                raise DefinitionError(
                    f"another job is writing `{text}`: wait until it ends, or choose another name", where="out"
                )
        name = secrets.token_hex(6)
        job = StudioJob(name, kind, command, self._private / f"job-{name}")
        self._jobs[name] = job
        self._forget()
        job.task = asyncio.get_running_loop().create_task(self._run(job))
        return job

    def find(self, name: str) -> StudioJob:
        """Return the job called `name`; raise LookupError if there is none."""
        return self._jobs[name]

    def of_key(self, key: str) -> StudioJob:
        """Return the job whose results have this `key`; raise LookupError if there is none."""
        for job in self._jobs.values():
            if secrets.compare_digest(job.key.encode(), key.encode("utf-8", "replace")):
                return job
        raise LookupError(key)

    def all(self) -> list[dict[str, Any]]:
        """Return all jobs as mappings for the page, the newest first, without logs and answers."""
        return [self.shown(job, detailed=False) for job in reversed(self._jobs.values())]

    def shown(self, job: StudioJob, *, detailed: bool = True) -> dict[str, Any]:
        """Return a `job` as a mapping for the page; if `detailed`, with its log, answer and links to its results."""
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
        if detailed:
            summary |= {"log": log, "answer": self._answer(job), "links": self._links(job) if job.over else []}
        return summary

    async def cancel(self, job: StudioJob) -> None:
        """End a `job` and its process; forget a job that has already ended."""
        if job.over:
            self._jobs.pop(job.name, None)
            shutil.rmtree(job.private, ignore_errors=True)
            return
        job.state = "cancelled"
        if job.process is not None:
            await end_process(job.process)
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

    async def _run(self, job: StudioJob) -> None:
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
                    job.process = await start_process(
                        self._folder.root,
                        job.private,
                        "slidax.studio.job",
                        [json.dumps(words)],
                        out=out,
                        errors=log,
                        low_priority=True,
                    )
                    if job.over:
                        await end_process(job.process, gently=False)
                    job.code = await job.process.wait()
                # Also end child processes that still run.
                await end_process(job.process, gently=False)
            except OSError as error:
                (job.private / "log").write_text(f"slidax: cannot start the job: {error}\n", encoding="utf-8")
            job.seconds = time.monotonic() - job.begun
            if not job.over:
                job.state = "done" if job.code in (0, 3, 4) else "failed"

    def _answer(self, job: StudioJob) -> Any:
        text = _tail(job.private / "out", ANSWER)
        if not job.command.json or not job.over:
            return text[-LOG:]
        try:
            return json.loads(text)
        except ValueError:
            return text[-LOG:]

    def _links(self, job: StudioJob) -> list[dict[str, str]]:
        """Return the files that a job has written, with their addresses."""
        out = job.command.out
        if not out:
            return []
        try:
            path = self._folder.resolve(out)
            names = [entry.name for entry in self._folder.listing(out)] if path.is_dir() else [out] * path.is_file()
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
