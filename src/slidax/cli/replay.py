"""`slidax replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import OUTCOME, errors_as_lines, prepare, print_json, say_warning


def replay(
    log: Annotated[Path, typer.Argument(help="An MCAP file of `slidax run` or `slidax loop`.")],
    json: AsJson = False,
) -> None:
    """A log through its law again: the same measurements must give the same torques, bit for bit.

    The log alone is needed: the scenario is in it.

    Exit code 0: all answers have the same bits; 2: the file is no such log; 3: one is another, which is said.
    """
    with errors_as_lines():
        prepare()
        from slidax.deploy.robot_loop import replay as replayed
        from slidax.logs import read_mcap

        read = read_mcap(log)
        if not read.whole:
            say_warning(f"`{log}` has no end, as its writer was stopped; it is read as far as it goes")
        found = replayed(read)
        if json:
            print_json({**found.as_json(), "whole": read.whole})
        else:
            typer.echo(found.sentence())
        if found.first is not None:
            raise typer.Exit(OUTCOME)
