"""What may be run as a job: commands of slidax, and what a page may say to each of them."""

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
class Asked:
    """A job's command, as it is put together.

    - `words`: after `slidax`.
    - `files`: that it reads, below the folder.
    - `changes`: values by path.
    - `out`: what it writes, a file or a folder; empty for nothing.
    - `replaces`: whether something is there already.
    - `json`: whether what it prints is JSON.
    """

    words: list[str]
    files: list[str]
    changes: dict[str, Any]
    out: str = ""
    replaces: bool = False
    json: bool = False


Reader = Callable[[Asked, Folder, Any, str], None]
"""Puts a value of the page into a command: `(asked, folder, value, name)`."""


def _scenario(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    if text.lower().endswith(YAML):
        _file(YAML)(asked, folder, value, name)
    else:
        asked.words.append(_word(text, name))


def _file(endings: tuple[str, ...], option: bool = False) -> Reader:
    def read(asked: Asked, folder: Folder, value: Any, name: str) -> None:
        text = _text(value, name)
        require_ending(text, endings)
        if not folder.place(text).is_file():
            raise DefinitionError(f"there is no file `{plain(text)}`", where=name)
        asked.files.append(text)
        asked.words.append(f"--{name}={text}" if option else text)

    return read


def _robot(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    if text.lower().endswith(".xacro"):
        raise DefinitionError("xacro is not expanded in the studio: run `xacro FILE > robot.urdf` first", where=name)
    if text.lower().endswith(ROBOTS):
        _file(ROBOTS, option=True)(asked, folder, value, name)
    else:
        asked.words.append(f"--{name}={_word(text, name)}")


def _finished(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    """The folder of a run, or its .mcap file."""
    text = _text(value, name)
    place = folder.place(text)
    if not (place.is_dir() or (place.is_file() and text.endswith(".mcap"))):
        raise DefinitionError(f"there is no run `{plain(text)}`", where=name)
    if place.is_dir():
        asked.files += [one.name for one in folder.listing(text) if one.name.endswith(YAML)]
    asked.words.append(text)


def _folder_out(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    text = _text(value, name)
    asked.replaces = not folder.is_free(text)
    asked.out = text
    asked.words.append(f"--out={text}")


def _file_out(endings: tuple[str, ...], option: str = "out") -> Reader:
    def write(asked: Asked, folder: Folder, value: Any, name: str) -> None:
        text = _text(value, name)
        require_ending(text, endings)
        asked.replaces = folder.place(text).exists()
        asked.out = text
        asked.words.append(f"--{option}={text}")

    return write


def _report(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    before = asked.out, asked.replaces
    _folder_out(asked, folder, value, name)
    asked.words[-1] = f"--report={asked.out}"
    asked.replaces = asked.replaces or before[1]


def _number(low: float, high: float, kind: type[int] | type[float] = int) -> Reader:
    def read(asked: Asked, folder: Folder, value: Any, name: str) -> None:
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise DefinitionError(f"must be a number from {low:g} to {high:g}; got {plain(value)}", where=name)
        if kind is int and value != int(value):
            raise DefinitionError(f"must be a whole number; got {plain(value)}", where=name)
        asked.words.append(f"--{name}={kind(value)}")

    return read


def _flag(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    if not isinstance(value, bool):
        raise DefinitionError(f"must be true or false; got {plain(value)}", where=name)
    if value:
        asked.words.append(f"--{name}")


def _named(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    words = [_word(word, name) for word in _text(value, name).split(",")]
    asked.words.append(f"--{name}={','.join(words)}")


def _changes(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    if not isinstance(value, dict):
        raise DefinitionError("must be values by path", where=name)
    for path, one in value.items():
        if not PATH.fullmatch(path):
            raise DefinitionError(f"`{plain(path)}` is no path of a field", where=name)
        asked.changes[path] = one
        asked.words.append(f"--set={path}={json.dumps(one, allow_nan=False)}")


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value:
        raise DefinitionError(f"must be text; got {plain(value)}", where=name)
    return value


def _word(value: str, name: str) -> str:
    if not WORD.fullmatch(value):
        raise DefinitionError(f"`{plain(value)}` is no name", where=name)
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
        {"robot": lambda asked, folder, value, name: _positional(asked, folder, value, name)}
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
"""By the name of a job: the command's words, what may be said to it in this order, whether it prints JSON."""

REQUIRED = ("scenario", "requirements", "robot", "log", "file", "run")
"""What a command cannot do without, where it takes it."""

WRITING = ("design", "excite", "export-c", "export-web")
"""Commands that need somewhere to write."""


def _positional(asked: Asked, folder: Folder, value: Any, name: str) -> None:
    _robot(asked, folder, value, name)
    asked.words[-1] = asked.words[-1].removeprefix(f"--{name}=")


def command_of(folder: Folder, job: str, said: Mapping[str, Any]) -> Asked:
    """The command of a job.

    - `folder`: of the studio.
    - `job`: one of `COMMANDS`.
    - `said`: values by name, as the page gives them; `replace` allows results to be written over.

    Raises DefinitionError for anything else than the command takes, and OutsideError for a file outside of the folder.
    """
    if job not in COMMANDS:
        raise DefinitionError(f"there is no job `{plain(job)}`; {nearest(str(job), COMMANDS)}")
    words, readers, answers = COMMANDS[job]
    asked = Asked([*words, *(["--json"] if answers else [])], [], {}, json=answers)
    for name in said:
        if name not in readers and name != "replace":
            raise DefinitionError(f"unknown `{plain(name)}`; {nearest(str(name), readers)}", where=job)
    for name, reader in readers.items():
        if said.get(name) not in (None, ""):
            reader(asked, folder, said[name], name)
        elif name in REQUIRED:
            raise DefinitionError("must be given", where=name)
    if job in WRITING and not asked.out:
        raise DefinitionError("must be given: where to write", where="out")
    if asked.replaces and said.get("replace") is not True and said.get("resume") is not True:
        raise FileExistsError(f"`{asked.out}` is there already")
    return asked
