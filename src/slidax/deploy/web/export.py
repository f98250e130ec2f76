"""A page that runs scenarios, as one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError
from slidax.scenarios import Scenario

from .beside import settings_of
from .playground import playground

PAGE = "index.html"


def of_scenario(scenario: Scenario, beside: Sequence[str] = ()) -> dict[str, Any]:
    """The manifest of one scenario.

    - `scenario`: it, as `load` gives it.
    - `beside`: names of schemes that are shown beside its own, and `printed` for the law as it is printed.

    Raises DefinitionError if there is no such scheme, or the scenario cannot run in a page.
    """
    description = scenario.description
    settings = settings_of(description, scenario.robot, beside)
    return playground(description.title, settings, {scenario.robot: scenario.robot.replace("_", " ")})


def write_page(manifest: Mapping[str, Any], out: Path) -> Path:
    """Writes the page of a manifest; returns where it is.

    - `manifest`: of `of_scenario` or `built_in`.
    - `out`: the folder; made if it is not there.

    Raises DefinitionError if it cannot be written.
    """
    from .page_text import page_text

    page = out / PAGE
    try:
        out.mkdir(parents=True, exist_ok=True)
        page.write_text(page_text(manifest), encoding="utf-8")
    except OSError as error:
        raise DefinitionError(f"cannot write the page to `{out}`: {error.strerror}") from None
    return page
