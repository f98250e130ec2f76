"""The commands in a block of a terminal, and whether the command line knows them."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .blocks import PageError

READ = {".yaml", ".yml", ".urdf", ".xml", ".mjcf", ".csv", ".json", ".mcap", ".parquet"}
"""Endings of files that commands read."""

WRITTEN = {"--out", "--record", "--log", "--histogram", "--report"}
"""Options whose value is written, unless it is there."""


@dataclass(frozen=True)
class Command:
    """A line that a reader types, and what the page shows below it.

    - `line`: without the prompt.
    - `shown`: the lines below it.
    """

    line: str
    shown: list[str] = field(default_factory=list)

    @property
    def arguments(self) -> list[str]:
        """What follows `slidax`, or everything where it is another program."""
        words = shlex.split(self.line, comments=True)
        return words[1:] if self.is_ours else words

    @property
    def is_ours(self) -> bool:
        """Whether it is `slidax` alone, with no other program behind it."""
        words = shlex.split(self.line, comments=True)
        return bool(words) and words[0] == "slidax" and not {"&&", "|", ">", ";"} & set(words)


def commands(language: str, text: str) -> list[Command]:
    """The commands of a block: after the prompt `$` in a `console`, every line in `sh`.

    - `language`, `text`: of the block.
    """
    found: list[Command] = []
    joined = text.replace("\\\n", " ")
    for line in joined.splitlines():
        if language == "console":
            if line.startswith("$ "):
                found.append(Command(line[2:].strip()))
            elif found:
                found[-1].shown.append(line)
        elif line.strip() and not line.lstrip().startswith("#"):
            found.append(Command(line.strip()))
    return found


def check(arguments: list[str], app: Any) -> None:
    """Whether the command line takes these arguments; nothing is run.

    - `arguments`: after `slidax`.
    - `app`: the command line of slidax.

    Raises PageError if there is no such command or option, or an argument is missing.
    """
    from typer.main import get_command

    command: Any = get_command(app)
    given, context = list(arguments), None
    try:
        while True:
            context = command.make_context("slidax", given, parent=context)
            if not hasattr(command, "resolve_command"):
                return
            rest = [*getattr(context, "_protected_args", []), *context.args]
            _, command, given = command.resolve_command(context, rest)
    except SystemExit:
        return
    except Exception as error:
        # `--help` and `--version` leave by an exception of their own.
        if type(error).__name__ in ("Exit", "NoArgsIsHelpError"):
            return
        said = getattr(error, "format_message", lambda: str(error))()
        raise PageError(f"`slidax {shlex.join(arguments)}`: {said}") from error


@dataclass
class Files:
    """Which files a reader has at a place of the page.

    - `folder`: where a reader stands: the root of a clone.
    - `made`: what the page has made before.
    """

    folder: Path
    made: set[str] = field(default_factory=set)

    def has(self, name: str) -> bool:
        """Whether a file is there, or in a folder that a command of the page has made.

        - `name`: as in the command.
        """
        path = Path(name)
        parents = {str(one) for one in path.parents} - {"."}
        return name in self.made or bool(parents & self.made) or (self.folder / path).exists()

    def follow(self, arguments: list[str]) -> None:
        """Notes what a command writes, and looks for what it reads.

        - `arguments`: of the command.

        Raises PageError if a file is nowhere.
        """
        before = ""
        for word in arguments:
            value = word.split("=", 1)[-1] if word.startswith("--") or "=" in word else word
            option = word.split("=", 1)[0] if word.startswith("--") and "=" in word else before
            if option in WRITTEN:
                self.made.add(value.rstrip("/"))
            elif Path(value).suffix in READ and not self.has(value):
                raise PageError(f"`{value}` is neither in the repository nor made before on this page")
            before = word
