"""`slidax reproduce`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .session import errors_as_lines, prepare, say_where

Disturbance = StrEnum("Disturbance", ["stated", "off", "both"])
"""Readings of the paper's disturbance."""


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report and results.json.")] = Path("reproduction"),
    disturbance: Annotated[Disturbance, typer.Option(help="As stated, off, or both.")] = Disturbance.both,
) -> None:
    """Compute the paper's figures and tables, and compare them with the printed ones in a report."""
    with errors_as_lines():
        prepare()
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        from slidax.papers import cftsmppc

        console = Console(stderr=True)
        columns = (TextColumn("{task.description:<44}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("starting", total=1.0)
            cftsmppc.reproduce(
                out,
                disturbance=disturbance.value,
                progress=lambda stage, done: bar.update(task, description=stage, completed=done),
            )
        say_where(out)
