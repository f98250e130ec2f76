"""`slidax export franka`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Changes, Named
from .session import errors_as_lines, parsed, prepare


def export_franka(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The folder of the project.")],
    name: Annotated[str | None, typer.Option(help="Of the law in C; after the scenario if not given.")] = None,
    single: Annotated[bool, typer.Option("--float", help="Floats in place of doubles.")] = False,
    changes: Changes = None,
) -> None:
    """The law as a program for a Franka arm: C++ around libfranka, Python around pylibfranka, and a rehearsal."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios
        from slidax.deploy.franka import export_franka as export

        parts = scenarios.load(scenario, parsed(changes or []))
        made = export(parts, out, name=name, single=single, command=shlex.join(["slidax", *sys.argv[1:]]))
        typer.echo(f"{made.law} in {made.real}s for a Franka arm: {out.resolve() / 'README.md'}")
