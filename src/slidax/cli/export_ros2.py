"""`slidax export ros2`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .exporting import Floats, LawName, exporting
from .options import Changes, Named

Gravity = StrEnum("Gravity", ["law", "robot"])
"""Who carries the arm's weight."""


def export_ros2(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The folder of the package.")],
    name: LawName = None,
    single: Floats = False,
    gravity: Annotated[
        Gravity, typer.Option(help="Who carries the weight: robot, if it adds it itself.")
    ] = Gravity.law,
    changes: Changes = None,
) -> None:
    """The law as a ROS 2 package: a controller for ros2_control with its parameters, and a node in Python."""
    with exporting(scenario, changes) as (parts, command):
        from slidax.deploy.ros2 import export_ros2 as export

        made = export(parts, out, name=name, single=single, command=command, gravity=gravity.value)
        typer.echo(f"{made.law} in {made.real}s for ros2_control: {out.resolve() / 'README.md'}")
