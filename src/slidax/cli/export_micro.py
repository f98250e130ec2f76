"""`slidax export micro`."""

from __future__ import annotations

import typer

from .exporting import Floats, Folder, LawName, exporting
from .options import Changes, Named


def export_micro(
    scenario: Named, out: Folder, name: LawName = None, single: Floats = False, changes: Changes = None
) -> None:
    """The control law for Cortex-M and RISC-V: a Makefile, start-up code, and a test that runs in emulators."""
    with exporting(scenario, changes) as (parts, command):
        from slidax.deploy import micro

        made = micro.export_micro(parts, out, name=name, single=single, command=command)
        typer.echo(f"{made.law} in {made.real}s, at most {made.stack} bytes of stack: make -C {out.resolve()} test")
