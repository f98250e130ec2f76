"""`slidax export c`."""

from __future__ import annotations

import typer

from .exporting import Floats, Folder, LawName, exporting
from .options import Changes, Named


def export_c(
    scenario: Named, out: Folder, name: LawName = None, single: Floats = False, changes: Changes = None
) -> None:
    """The control law as a C99 project: library, tests against Python, latency benchmark, example, C++ wrapper."""
    with exporting(scenario, changes) as (parts, command):
        from slidax import deploy

        out.mkdir(parents=True, exist_ok=True)
        made = deploy.export_c(parts, out, name=name, single=single, command=command)
        size = deploy.measured(made, out)
        most = "" if made.longest is None else f" and {made.longest.operations} operations"
        said = f"{made.law} in {made.real}s, at most {made.stack} bytes of stack{most} a step, {size}"
        typer.echo(f"{said}: {out.resolve() / 'README.md'}")
