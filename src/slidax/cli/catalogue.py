"""`slidax list`, `slidax schema` and `slidax studio`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from .common import AsJson, columns, errors_as_lines, prepare, print_json, say, wrapped


def list_(
    name: Annotated[
        str | None,
        typer.Argument(help="A kind, such as schemes, or a part, such as cftsmppc; default: all kinds."),
    ] = None,
    json: AsJson = False,
) -> None:
    """List what is available, one line each, or the parameters of a part with unit, range, default and source.

    If several kinds have the name, put the kind before it, such as performance.fixed_time.
    """
    with errors_as_lines():
        prepare()
        from slidax.scenarios.catalogue import catalogue, explain_parameters

        kinds = catalogue()
        if name is not None and name not in kinds:
            part = explain_parameters(name)
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
                say(f"{label:<{width}}  {line}", margin="" if name else "  ", hang=width + 2)


def schema() -> None:
    """Print the JSON schema of scenario files, for editors and other programs."""
    with errors_as_lines():
        prepare()
        from slidax import scenarios

        print_json(scenarios.schema())


def _print_part(part: dict[str, Any]) -> None:
    width = columns(sys.stdout)
    typer.echo(typer.style(wrapped(part["title"], width), bold=True))
    for row in part["parameters"]:
        default = row["default"]
        value = "required" if row["required"] else "not set" if default in (None, {}, [], ()) else _shown(default)
        source = f" ({row['source']})" if row["source"] else ""
        unit = f" [{row['unit']}]" if row["unit"] else ""
        path = row["path"]
        lines = wrapped(f"{path}{unit}: {value}{source}", width, hang=4)
        typer.echo(f"{typer.style(path, bold=True)}{lines.removeprefix(path)}")
        meaning = "; ".join(text for text in (row["meaning"], row["range"]) if text)
        if meaning:
            say(meaning, margin="    ")


def _shown(default: Any) -> str:
    return f"{default:g}" if isinstance(default, float) else str(default)


def studio(
    scenario: Annotated[str, typer.Argument(help="Scenario to open: a built-in one by name, or a YAML file.")] = "",
    folder: Annotated[Path, typer.Option(help="Folder to read and write.")] = Path(),
    port: Annotated[int | None, typer.Option(help="Port of the page; 0: any free port.", min=0, max=65535)] = None,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """Serve the studio on this machine: sliders, studies, design, certificates and export in the browser.

    The studio reads and writes only below its folder, and answers only this machine. Ctrl-C ends it with its jobs.
    """
    with errors_as_lines():
        from slidax.report.replay.drawing import require_packages

        require_packages("the studio", "starlette", "uvicorn", extra="studio")
        from slidax.core.errors import DefinitionError
        from slidax.studio.files import Folder
        from slidax.studio.server import serve

        root = Folder(folder)
        opened = scenario
        if Path(scenario).suffix in (".yaml", ".yml"):
            if not Path(scenario).is_file():
                raise DefinitionError(f"file `{scenario}` does not exist")
            opened = root.beneath(Path(scenario), scenario).relative_to(root.root).as_posix()
        serve(root.root, module="slidax.cli", opened=opened, port=port, browser=browser, say=typer.echo)
