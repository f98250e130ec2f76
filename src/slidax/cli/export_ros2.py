"""`slidax export ros2`."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .options import Changes, Named
from .session import errors_as_lines, parsed, prepare

Gravity = StrEnum("Gravity", ["law", "robot"])
"""Who carries the arm's weight."""


def export_ros2(
    scenario: Named,
    out: Annotated[Path, typer.Option(help="The folder of the package.")],
    name: Annotated[str | None, typer.Option(help="Of the law in C; after the scenario if not given.")] = None,
    single: Annotated[bool, typer.Option("--float", help="Floats in place of doubles.")] = False,
    gravity: Annotated[
        Gravity, typer.Option(help="Who carries the weight: robot, if it adds it itself.")
    ] = Gravity.law,
    changes: Changes = None,
) -> None:
    """The law as a ROS 2 package: a controller for ros2_control with its parameters, and a node in Python."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios
        from slidax.deploy.ros2 import export_ros2 as export

        parts = scenarios.load(scenario, parsed(changes or []))
        told = shlex.join(["slidax", *sys.argv[1:]])
        made = export(parts, out, name=name, single=single, command=told, gravity=gravity.value)
        typer.echo(f"{made.law} in {made.real}s for ros2_control: {out.resolve() / 'README.md'}")
