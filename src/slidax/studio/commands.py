"""Commands that can run as jobs, and their options on the page."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from slidax._errors import DefinitionError, nearest, plain

from .folder import Folder
from .names import require_ending

YAML = (".yaml", ".yml")
LOGS = (".csv", ".parquet", ".mcap", ".json", ".jsonl")
ROBOTS = (".urdf", ".xml", ".mjcf", *YAML)

WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,63}")
PATH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,199}")


@dataclass
class JobCommand:
    """The command of a job.

    - `words`: arguments after `slidax`.
    - `files`: that it reads, below the folder.
    - `changes`: values by path.
    - `out`: the file or folder that it writes, or empty.
    - `replaces`: True if `out` exists.
    - `json`: True if it prints JSON.
    """

    words: list[str]
    files: list[str]
    changes: dict[str, Any]
    out: str = ""
    replaces: bool = False
    json: bool = False


Reader = Callable[[JobCommand, Folder, Any, str], None]
"""Adds an option of the page to a command: `(command, folder, value, name)`."""


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
        if not folder.place(text).is_file():
            raise DefinitionError(f"file `{plain(text)}` does not exist", where=name)
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
    """The folder of a run, or its .mcap file."""
    text = _text(value, name)
    place = folder.place(text)
    if not (place.is_dir() or (place.is_file() and text.endswith(".mcap"))):
        raise DefinitionError(f"run `{plain(text)}` does not exist", where=name)
    if place.is_dir():
        command.files += [entry.name for entry in folder.listing(text) if entry.name.endswith(YAML)]
    command.words.append(text)


def _folder_out(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    command.replaces = not folder.is_free(text)
    command.out = text
    command.words.append(f"--out={text}")


def _file_out(endings: tuple[str, ...], option: str = "out") -> Reader:
    def write(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
        text = _text(value, name)
        require_ending(text, endings)
        command.replaces = folder.place(text).exists()
        command.out = text
        command.words.append(f"--{option}={text}")

    return write


def _report(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    before = command.out, command.replaces
    _folder_out(command, folder, value, name)
    command.words[-1] = f"--report={command.out}"
    command.replaces = command.replaces or before[1]


def _number(low: float, high: float, kind: type[int] | type[float] = int) -> Reader:
    def read(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise DefinitionError(f"must be a number from {low:g} to {high:g}; got {plain(value)}", where=name)
        if kind is int and value != int(value):
            raise DefinitionError(f"must be an integer; got {plain(value)}", where=name)
        command.words.append(f"--{name}={kind(value)}")

    return read


def _flag(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    if not isinstance(value, bool):
        raise DefinitionError(f"must be true or false; got {plain(value)}", where=name)
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
            raise DefinitionError(f"`{plain(path)}` is not the path of a field", where=name)
        command.changes[path] = content
        command.words.append(f"--set={path}={json.dumps(content, allow_nan=False)}")


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value:
        raise DefinitionError(f"must be text; got {plain(value)}", where=name)
    return value


def _word(value: str, name: str) -> str:
    if not WORD.fullmatch(value):
        raise DefinitionError(f"`{plain(value)}` is not a valid name", where=name)
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
"""For each job: the command's words, its options in this order, and True if it prints JSON."""

REQUIRED = ("scenario", "requirements", "robot", "log", "file", "run")
"""Options that are required where a command has them."""

WRITING = ("design", "excite", "export-c", "export-web")
"""Commands that require `out`."""


def _positional(command: JobCommand, folder: Folder, value: Any, name: str) -> None:
    _robot(command, folder, value, name)
    command.words[-1] = command.words[-1].removeprefix(f"--{name}=")


def command_of(folder: Folder, job: str, options: Mapping[str, Any]) -> JobCommand:
    """The command of a `job` with `options` from the page; the option `replace` allows overwriting results.

    Raises DefinitionError for unknown or invalid options, and OutsideError for a file outside the `folder`.
    """
    if job not in COMMANDS:
        raise DefinitionError(f"unknown job `{plain(job)}`; {nearest(str(job), COMMANDS)}")
    words, readers, answers = COMMANDS[job]
    command = JobCommand([*words, *(["--json"] if answers else [])], [], {}, json=answers)
    for name in options:
        if name not in readers and name != "replace":
            raise DefinitionError(f"unknown `{plain(name)}`; {nearest(str(name), readers)}", where=job)
    for name, reader in readers.items():
        if options.get(name) not in (None, ""):
            reader(command, folder, options[name], name)
        elif name in REQUIRED:
            raise DefinitionError("is required", where=name)
    if job in WRITING and not command.out:
        raise DefinitionError("is required: the file or folder to write", where="out")
    if command.replaces and options.get("replace") is not True and options.get("resume") is not True:
        raise FileExistsError(f"`{command.out}` exists already")
    return command
