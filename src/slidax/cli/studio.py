"""`slidax studio`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .session import errors_as_lines


def studio(
    scenario: Annotated[str, typer.Argument(help="What is opened: a built-in scenario by name, or a YAML file.")] = "",
    folder: Annotated[Path, typer.Option(help="The folder that is read and written.")] = Path(),
    port: Annotated[int | None, typer.Option(help="Where; 0 for any free one.", min=0, max=65535)] = None,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """A page to try laws on any arm, on this machine: sliders, studies, design, certificates, export.

    It reads and writes below its folder alone, answers this machine alone, and ends with Ctrl-C, and its jobs with it.
    """
    with errors_as_lines():
        from slidax.studio.needed import require_studio

        require_studio()
        from slidax._errors import DefinitionError
        from slidax.studio.folder import Folder
        from slidax.studio.server import serve

        root = Folder(folder)
        opened = scenario
        if Path(scenario).suffix in (".yaml", ".yml"):
            if not Path(scenario).is_file():
                raise DefinitionError(f"there is no file `{scenario}`")
            opened = root.beneath(Path(scenario), scenario).relative_to(root.root).as_posix()
        serve(root.root, module="slidax.cli", opened=opened, port=port, browser=browser, say=_say)


def _say(line: str) -> None:
    typer.echo(line)
