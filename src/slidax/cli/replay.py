"""`slidax replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import OUTCOME, errors_as_lines, prepare, print_json, say_warning


def replay(
    log: Annotated[Path, typer.Argument(help="MCAP file from `slidax run` or `slidax loop`.")],
    json: AsJson = False,
) -> None:
    """Replay a log through its law: the same measurements must give the same torques, bit for bit.

    The log contains the scenario.

    Exit code 0: all torques are identical; 2: the file is not such a log; 3: the torques differ; the first is printed.
    """
    with errors_as_lines():
        prepare()
        from slidax.deploy.robot_loop import replay as replayed
        from slidax.logs import read_mcap

        content = read_mcap(log)
        if not content.whole:
            say_warning(f"`{log}` is incomplete because its writer was stopped; the complete part is read")
        comparison = replayed(content)
        if json:
            print_json({**comparison.as_json(), "whole": content.whole})
        else:
            typer.echo(comparison.sentence())
        if comparison.first is not None:
            raise typer.Exit(OUTCOME)
