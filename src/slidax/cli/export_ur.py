"""`slidax export ur`."""

from __future__ import annotations

import typer

from .exporting import Floats, Folder, LawName, exporting
from .options import Changes, Named


def export_ur(
    scenario: Named, out: Folder, name: LawName = None, single: Floats = False, changes: Changes = None
) -> None:
    """The law as a program for an arm of Universal Robots: Python around ur_rtde's directTorque, and a rehearsal."""
    with exporting(scenario, changes) as (parts, command):
        from slidax.deploy.ur import export_ur as export

        made = export(parts, out, name=name, single=single, command=command)
        typer.echo(f"{made.law} in {made.real}s for an arm of Universal Robots: {out.resolve() / 'README.md'}")
