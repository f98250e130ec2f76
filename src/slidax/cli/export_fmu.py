"""`slidax export fmu`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Changes, Named
from .session import errors_as_lines, parsed, prepare


def export_fmu(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The file, NAME.fmu.")],
    name: Annotated[str | None, typer.Option(help="Of the law in C; after the scenario if not given.")] = None,
    fmi: Annotated[int, typer.Option(help="3 for FMI 3.0, 2 for FMI 2.0.")] = 3,
    platforms: Annotated[
        str | None, typer.Option(help="With commas, such as x86_64-linux,x86_64-windows; all if not given.")
    ] = None,
    changes: Changes = None,
) -> None:
    """The control law as a Functional Mock-up Unit for co-simulation, with binaries and sources."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios
        from slidax.deploy import fmu

        parts = scenarios.load(scenario, parsed(changes or []))
        command = shlex.join(["slidax", *sys.argv[1:]])
        which = None if platforms is None else [each.strip() for each in platforms.split(",")]
        made = fmu.export_fmu(parts, out, name=name, fmi=fmi, platforms=which, command=command)
        typer.echo(
            f"{made.project.law}, FMI {fmi}.0, {len(made.variables)} variables, a step every "
            f"{made.project.period_text}, for {', '.join(made.platforms)}: {out.resolve()}"
        )
