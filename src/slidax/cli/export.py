"""`slidax export`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Changes, Named
from .session import errors_as_lines, parsed, prepare


def export_c(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The folder of the project.")],
    name: Annotated[str | None, typer.Option(help="Of the law in C; after the scenario if not given.")] = None,
    single: Annotated[bool, typer.Option("--float", help="Floats in place of doubles.")] = False,
    changes: Changes = None,
) -> None:
    """The control law as a C99 project: library, tests against Python, latency benchmark, example, C++ wrapper."""
    with errors_as_lines():
        prepare()
        from slidax import deploy, scenarios

        parts = scenarios.load(scenario, parsed(changes or []))
        out.mkdir(parents=True, exist_ok=True)
        made = deploy.export_c(parts, out, name=name, single=single, command=shlex.join(["slidax", *sys.argv[1:]]))
        size = deploy.measured(made, out)
        said = f"{made.law} in {made.real}s, at most {made.stack} bytes of stack, {size}"
        typer.echo(f"{said}: {out.resolve() / 'README.md'}")
