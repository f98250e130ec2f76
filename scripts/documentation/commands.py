"""Commands on pages, compared with the parser; and the reference page of the command line, written from it."""

from __future__ import annotations

import enum
import shlex
import typing
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"

HEAD = """\
# Command line

Written by `scripts/build-site --commands`; do not edit. `slidax COMMAND --help` prints the same text.

`SCENARIO` is a built-in scenario (`slidax list scenarios`) or a YAML file ([scenario files](scenarios.md)). Results go
to standard output; errors, warnings and notes go to standard error. `NO_COLOR=1` switches colours off.
`slidax --allow-code COMMAND` lets files name [classes of your own](your-own-law.md) as `module:Class`.

## Exit codes

| code | meaning |
|---:|---|
"""

CODES = {
    0: "success",
    1: "a fault of slidax, with a traceback: please report it",
    2: "invalid command, option or file; or the output cannot be written",
    3: "the run ended badly: outside its envelope, infinite, or stopped",
    4: "a certificate does not hold, a design or a motion is refused, or the loop is unstable",
    130: "interrupted by Ctrl-C",
}
"""Exit codes of all commands."""


def commands_page() -> str:
    """The page, as Markdown."""
    from slidax.cli import app

    commands = dict(_commands(app))
    lines = [f"| {code} | {meaning} |" for code, meaning in CODES.items()]
    lines += ["", "Each command below states its own meanings.", "", "## Commands", ""]
    lines += ["| command | purpose |", "|---|---|"]
    for words, command in commands.items():
        first = command.help.partition("\n\n")[0].replace("\n", " ")
        lines.append(f"| [`{words}`](#{words.replace(' ', '-')}) | {_cell(first)} |")
    for words, command in commands.items():
        lines += ["", *_section(words, command)]
    return HEAD + "\n".join([*lines, ""])


def _commands(app: Any) -> Iterator[tuple[str, Any]]:
    """All commands with their words."""
    from typer.main import get_command

    def below(command: Any, words: str) -> Iterator[tuple[str, Any]]:
        for name, inner in getattr(command, "commands", {}).items():
            yield from below(inner, f"{words} {name}")
        if not hasattr(command, "commands"):
            yield words, command

    yield from below(get_command(app), "slidax")


def _section(words: str, command: Any) -> list[str]:
    example = (command.epilog or "").removeprefix("Example:").partition("  (")[0].strip()
    lines = [f"## {words}", "", command.help.strip(), ""]
    lines += ["<!-- not run: the form of the command -->", "```sh", example, "```"] if example else []
    hints = typing.get_type_hints(command.callback)
    rows = [_row(parameter, hints[parameter.name]) for parameter in command.params if parameter.name in hints]
    return [*lines, "", "| argument or option | meaning | default |", "|---|---|---|", *rows] if rows else lines


def _row(parameter: Any, hint: Any) -> str:
    kinds = [kind for kind in (hint, *typing.get_args(hint)) if isinstance(kind, type) and issubclass(kind, enum.Enum)]
    value = "\\|".join(entry.value for entry in kinds[0]) if kinds else parameter.metavar or parameter.name.upper()
    # 0 is a default, although it equals False.
    empty = parameter.default is None or parameter.default is False or parameter.default in ("", ())
    default = "" if empty else f"`{parameter.default}`"
    if parameter.param_type_name == "argument":
        name = f"`{value}`"
    elif not parameter.is_flag:
        name = f"`{parameter.opts[0]} {value}`"
    else:
        name = ", ".join(f"`{word}`" for word in [*parameter.opts, *parameter.secondary_opts])
        if parameter.secondary_opts and parameter.default is not None:
            default = f"`{(parameter.opts if parameter.default else parameter.secondary_opts)[0]}`"
    return f"| {name} | {_cell(parameter.help or '')} | {'required' if parameter.required else default} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def write() -> None:
    """Write the page."""
    PAGE.write_text(commands_page(), encoding="utf-8")


class PageError(Exception):
    """A page is not as it should be."""


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
        """Words after `slidax`, or all words of another program's command."""
        words = shlex.split(self.line, comments=True)
        return words[1:] if self.is_ours else words

    @property
    def is_ours(self) -> bool:
        """True if the line is one `slidax` command, without another program."""
        words = shlex.split(self.line, comments=True)
        return bool(words) and words[0] == "slidax" and not {"&&", "|", ">", ";"} & set(words)


def commands(language: str, text: str) -> list[Command]:
    """The commands of a block: after the prompt `$` in a `console`, every line in `sh`."""
    typed: list[Command] = []
    joined = text.replace("\\\n", " ")
    for line in joined.splitlines():
        if language == "console":
            if line.startswith("$ "):
                typed.append(Command(line[2:].strip()))
            elif typed:
                typed[-1].shown.append(line)
        elif line.strip() and not line.lstrip().startswith("#"):
            typed.append(Command(line.strip()))
    return typed


def check(arguments: list[str], app: Any) -> None:
    """Check that the command line takes these arguments; nothing is run.

    Raises PageError if there is no such command or option, or an argument is missing.
    """
    from typer.main import get_command

    command: Any = get_command(app)
    words, context = list(arguments), None
    try:
        while True:
            context = command.make_context("slidax", words, parent=context)
            if not hasattr(command, "resolve_command"):
                return
            rest = [*getattr(context, "_protected_args", []), *context.args]
            _, command, words = command.resolve_command(context, rest)
    except SystemExit:
        return
    except Exception as error:
        # `--help` and `--version` leave by an exception of their own.
        if type(error).__name__ in ("Exit", "NoArgsIsHelpError"):
            return
        message = getattr(error, "format_message", lambda: str(error))()
        raise PageError(f"`slidax {shlex.join(arguments)}`: {message}") from error


@dataclass
class Files:
    """Files that a reader has at a place of the page.

    - `folder`: where a reader stands: the root of a clone.
    - `written`: what the page has written before.
    """

    folder: Path
    written: set[str] = field(default_factory=set)

    def has(self, name: str) -> bool:
        """True if a file exists, or is in a folder that a command of the page has written."""
        path = Path(name)
        parents = {str(parent) for parent in path.parents} - {"."}
        return name in self.written or bool(parents & self.written) or (self.folder / path).exists()

    def follow(self, arguments: list[str]) -> None:
        """Note what a command writes, and looks for what it reads.

        Raises PageError if a file is nowhere.
        """
        before = ""
        for word in arguments:
            value = word.split("=", 1)[-1] if word.startswith("--") or "=" in word else word
            option = word.split("=", 1)[0] if word.startswith("--") and "=" in word else before
            if option in WRITTEN:
                self.written.add(value.rstrip("/"))
            elif Path(value).suffix in READ and not self.has(value):
                raise PageError(f"`{value}` is neither in the repository nor written before on this page")
            before = word
