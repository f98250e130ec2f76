"""The reference page of the command line, from the parser."""

from __future__ import annotations

import enum
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"

HEAD = """\
# Command line

Written by `scripts/write-commands`; do not edit. `slidax COMMAND --help` prints the same text.

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
    default = "" if parameter.default in (None, False, "", ()) else f"`{parameter.default}`"
    if parameter.param_type_name == "argument":
        name = f"`{value}`"
    elif not parameter.is_flag:
        name = f"`{parameter.opts[0]} {value}`"
    else:
        name = ", ".join(f"`{word}`" for word in [*parameter.opts, *parameter.secondary_opts])
        if parameter.secondary_opts:
            default = f"`{(parameter.opts if parameter.default else parameter.secondary_opts)[0]}`"
    return f"| {name} | {_cell(parameter.help or '')} | {'required' if parameter.required else default} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def write() -> None:
    """Write the page."""
    PAGE.write_text(commands_page(), encoding="utf-8")
