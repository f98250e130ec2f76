"""`slidax list` and `slidax schema`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from .options import AsJson
from .session import errors_as_lines, prepare, print_json


def list_(
    name: Annotated[
        str | None,
        typer.Argument(help="A kind, such as schemes, or a part, such as cftsmppc; default: all kinds."),
    ] = None,
    json: AsJson = False,
) -> None:
    """List what is available, one line each, or the parameters of a part with unit, range, default and source.

    For a name that several kinds have, give the kind, too: performance.fixed_time.
    """
    with errors_as_lines():
        prepare()
        from slidax.scenarios import catalogue, explained

        kinds = catalogue()
        if name is not None and name not in kinds:
            part = explained(name)
            print_json({key: part[key] for key in ("name", "parameters")}) if json else _print_part(part)
            return
        shown = {name: kinds[name]} if name else kinds
        if json:
            print_json(shown)
            return
        width = max(len(label) for members in shown.values() for label in members)
        for title, members in shown.items():
            if not name:
                typer.echo(typer.style(title, bold=True))
            for label, line in members.items():
                typer.echo(f"{'' if name else '  '}{label:<{width}}  {line}")


def schema() -> None:
    """Print the JSON schema of scenario files, for editors and other programs."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios

        print_json(scenarios.schema())


def _print_part(part: dict[str, Any]) -> None:
    typer.echo(typer.style(part["title"], bold=True))
    for row in part["parameters"]:
        default = row["default"]
        value = "required" if row["required"] else "not set" if default in (None, {}, [], ()) else _shown(default)
        source = f" ({row['source']})" if row["source"] else ""
        unit = f" [{row['unit']}]" if row["unit"] else ""
        typer.echo(f"{typer.style(row['path'], bold=True)}{unit}: {value}{source}")
        meaning = "; ".join(text for text in (row["meaning"], row["range"]) if text)
        if meaning:
            typer.echo(f"    {meaning}")


def _shown(default: Any) -> str:
    return f"{default:g}" if isinstance(default, float) else str(default)
