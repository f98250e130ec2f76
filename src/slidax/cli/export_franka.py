"""`slidax export franka`."""

from __future__ import annotations

import typer

from .exporting import Floats, Folder, LawName, exporting
from .options import Changes, Named


def export_franka(
    scenario: Named, out: Folder, name: LawName = None, single: Floats = False, changes: Changes = None
) -> None:
    """The law as a program for a Franka arm: C++ around libfranka, Python around pylibfranka, and a rehearsal."""
    with exporting(scenario, changes) as (parts, command):
        from slidax.deploy.franka import export_franka as export

        made = export(parts, out, name=name, single=single, command=command)
        typer.echo(f"{made.law} in {made.real}s for a Franka arm: {out.resolve() / 'README.md'}")
