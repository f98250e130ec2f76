"""`slidax export web`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import Changes
from .session import errors_as_lines, parsed, prepare


def export_web(
    out: Annotated[Path, typer.Option(help="The folder of the page.")],
    scenario: Annotated[
        str | None,
        typer.Argument(help="A built-in scenario by name, or a YAML file; the whole playground if not given."),
    ] = None,
    beside: Annotated[
        str | None,
        typer.Option("--with", help="With commas: schemes beside the scenario's own, and `printed` for it as printed."),
    ] = None,
    certify_rate: Annotated[
        bool,
        typer.Option(help="Also certify the loop's rate of an arm of more than three joints, which takes minutes."),
    ] = False,
    changes: Changes = None,
) -> None:
    """A page that runs the closed loop in the browser, with a slider for every number: one file, without a server.

    Without a scenario it is the playground: three arms, each under five laws.
    """
    with errors_as_lines():
        prepare()
        from slidax._errors import DefinitionError, counted
        from slidax.deploy import web
        from slidax.scenarios import load

        if scenario is None:
            if beside or changes or certify_rate:
                raise DefinitionError("`--with`, `--certify-rate` and `--set` are for one scenario: name it")
            manifest = web.built_in()
        else:
            names = [name.strip() for name in (beside or "").split(",") if name.strip()]
            manifest = web.of_scenario(load(scenario, parsed(changes or [])), names, certify_rate)
        page = web.write_page(manifest, out)
        tunables = sum(len(setting["tunables"]) for setting in manifest["settings"])
        typer.echo(
            f"{counted(len(manifest['settings']), 'law')}, {counted(len(manifest['programs']), 'program')}, "
            f"{counted(tunables, 'slider')}, {page.stat().st_size / 1e6:.2f} MB: {page.resolve()}"
        )
