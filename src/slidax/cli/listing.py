"""`slidax list` and `slidax schema`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from .options import AsJson
from .session import errors_as_lines, prepare, print_json

Kind = StrEnum(
    "Kind",
    ["schemes", "robots", "trajectories", "disturbances", "estimators", "performance", "scenarios"],
)
"""What can be listed."""


def list_(
    kind: Annotated[Kind | None, typer.Argument(help="What to list; everything if not given.")] = None,
    json: AsJson = False,
) -> None:
    """What there is, one line each."""
    with errors_as_lines():
        prepare()
        from slidax.scenarios import catalogue

        found = catalogue()
        shown = {kind.value: found[kind.value]} if kind else found
        if json:
            print_json(shown)
            return
        width = max(len(name) for members in shown.values() for name in members)
        for title, members in shown.items():
            if not kind:
                typer.echo(typer.style(title, bold=True))
            for name, line in members.items():
                typer.echo(f"{'' if kind else '  '}{name:<{width}}  {line}")


def schema() -> None:
    """The JSON schema of scenario files, for editors and other programs."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios

        print_json(scenarios.schema())
