"""`slidax export micro`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Changes, Named
from .session import errors_as_lines, parsed, prepare


def export_micro(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The folder of the project.")],
    name: Annotated[str | None, typer.Option(help="Of the law in C; after the scenario if not given.")] = None,
    single: Annotated[bool, typer.Option("--float", help="Floats in place of doubles.")] = False,
    changes: Changes = None,
) -> None:
    """The control law for Cortex-M and RISC-V: a Makefile, start-up code, and a test that runs in emulators."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios
        from slidax.deploy import micro

        parts = scenarios.load(scenario, parsed(changes or []))
        command = shlex.join(["slidax", *sys.argv[1:]])
        made = micro.export_micro(parts, out, name=name, single=single, command=command)
        typer.echo(f"{made.law} in {made.real}s, at most {made.stack} bytes of stack: make -C {out.resolve()} test")
