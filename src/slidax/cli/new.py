"""`slidax new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from slidax._writing import write_text

from .session import errors_as_lines, prepare


def new(
    robot: Annotated[str, typer.Option(help="A URDF or MJCF file, or a ready robot by name.")],
    rate: Annotated[float, typer.Option(help="Sampling rate of the controller [Hz].")] = 1000.0,
    out: Annotated[Path | None, typer.Option(help="Write the scenario there, as YAML; else it is printed.")] = None,
    tip: Annotated[str | None, typer.Option(help="The link at the arm's end; else found.")] = None,
) -> None:
    """A commented scenario that runs, for any arm.

    Home, motion, torques, envelope and estimator are chosen by the arm's own numbers. Where its file has a placeholder
    or nothing, such as 300 N m on every joint, what is assumed instead is said, here and in the file. Grippers, cameras
    and heads are held.
    """
    with errors_as_lines():
        prepare()
        from slidax._errors import DefinitionError
        from slidax.commissioning import draft

        if out is not None and out.suffix not in (".yaml", ".yml"):
            raise DefinitionError(f"a scenario file needs the ending .yaml; got `{out}`")
        if out is not None and out.exists():
            raise DefinitionError(f"`{out}` is there already; give another name, or remove it")
        made = draft(robot, rate, tip=tip, folder=Path() if out is None else out.parent)
        if out is None:
            typer.echo(made.text, nl=False)
        else:
            write_text(out, made.text)
        for note in made.notes:
            typer.echo(f"assumed: {note}", err=True)
        if out is not None:
            typer.echo(f"The scenario is in {out}; next: slidax run {out}", err=True)
