"""What the commands `slidax export ...` share: their options, and what each begins with."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .session import errors_as_lines, parsed, prepare

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

Folder = Annotated[Path, typer.Option(help="The folder of the project.")]

LawName = Annotated[str | None, typer.Option(help="Name of the law in C; after the scenario if not given.")]

Floats = Annotated[bool, typer.Option("--float", help="Floats in place of doubles.")]


@contextmanager
def exporting(scenario: str, changes: list[str] | None) -> Iterator[tuple[Scenario, str]]:
    """What is exported, and the command that asked for it; errors become lines.

    - `scenario`: its name or file.
    - `changes`: of it, `PATH=VALUE`.
    """
    with errors_as_lines():
        prepare()
        from slidax import scenarios

        yield scenarios.load(scenario, parsed(changes or [])), shlex.join(["slidax", *sys.argv[1:]])
