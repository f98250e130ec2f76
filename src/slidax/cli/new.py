"""`slidax new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from slidax._writing import write_text

from .session import errors_as_lines, prepare


def new(
    robot: Annotated[str, typer.Option(help="A URDF or MJCF file, or a built-in arm by name.")],
    rate: Annotated[float, typer.Option(help="Sampling rate of the controller [Hz].")] = 1000.0,
    out: Annotated[Path | None, typer.Option(help="YAML file for the scenario; default: print it.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link at the arm's tip; default: found automatically.")] = None,
) -> None:
    """Write a commented scenario that runs, for any arm.

    Home position, motion, torques, envelope and estimator follow from the arm's data. Missing data and placeholders,
    such as 300 N m on every joint, are replaced by assumptions, which are printed and written into the file. Grippers,
    cameras and heads are locked.
    """
    with errors_as_lines():
        prepare()
        from slidax._errors import DefinitionError
        from slidax.commissioning import draft

        if out is not None and out.suffix not in (".yaml", ".yml"):
            raise DefinitionError(f"a scenario file needs the ending .yaml; got `{out}`")
        if out is not None and out.exists():
            raise DefinitionError(f"`{out}` exists already: give another name, or remove it")
        scenario = draft(robot, rate, tip=tip, folder=Path() if out is None else out.parent)
        if out is None:
            typer.echo(scenario.text, nl=False)
        else:
            write_text(out, scenario.text)
        for note in scenario.notes:
            typer.echo(f"assumed: {note}", err=True)
        if out is not None:
            typer.echo(f"The scenario is in {out}; next: slidax run {out}", err=True)
