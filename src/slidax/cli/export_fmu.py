"""`slidax export fmu`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .exporting import LawName, exporting
from .options import Changes, Named


def export_fmu(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The file, NAME.fmu.")],
    name: LawName = None,
    fmi: Annotated[int, typer.Option(help="3 for FMI 3.0, 2 for FMI 2.0.")] = 3,
    platforms: Annotated[
        str | None, typer.Option(help="With commas, such as x86_64-linux,x86_64-windows; all if not given.")
    ] = None,
    changes: Changes = None,
) -> None:
    """The control law as a Functional Mock-up Unit for co-simulation, with binaries and sources."""
    with exporting(scenario, changes) as (parts, command):
        from slidax.deploy import fmu

        which = None if platforms is None else [each.strip() for each in platforms.split(",")]
        made = fmu.export_fmu(parts, out, name=name, fmi=fmi, platforms=which, command=command)
        typer.echo(
            f"{made.project.law}, FMI {fmi}.0, {len(made.variables)} variables, a step every "
            f"{made.project.period_text}, for {', '.join(made.platforms)}: {out.resolve()}"
        )
