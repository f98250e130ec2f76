"""`slidax studio`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .session import errors_as_lines


def studio(
    scenario: Annotated[str, typer.Argument(help="Scenario to open: a built-in one by name, or a YAML file.")] = "",
    folder: Annotated[Path, typer.Option(help="Folder to read and write.")] = Path(),
    port: Annotated[int | None, typer.Option(help="Port; 0 is any free one.", min=0, max=65535)] = None,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """Serve the studio on this machine: sliders, studies, design, certificates and export in the browser.

    The studio reads and writes only below its folder, and answers only this machine. Ctrl-C ends it with its jobs.
    """
    with errors_as_lines():
        from slidax.views.needed import require_packages

        require_packages("the studio", "starlette", "uvicorn", extra="studio")
        from slidax._errors import DefinitionError
        from slidax.studio.folder import Folder
        from slidax.studio.server import serve

        root = Folder(folder)
        opened = scenario
        if Path(scenario).suffix in (".yaml", ".yml"):
            if not Path(scenario).is_file():
                raise DefinitionError(f"file `{scenario}` does not exist")
            opened = root.beneath(Path(scenario), scenario).relative_to(root.root).as_posix()
        serve(root.root, module="slidax.cli", opened=opened, port=port, browser=browser, say=typer.echo)
