"""A page that runs scenarios, as one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError
from slidax._writing import reason, write_text
from slidax.scenarios import Scenario, ScenarioDescription

from .beside import settings_of
from .playground import playground
from .setting import Choice

PAGE_FILE = "index.html"

FEW = 3
"""Joints up to which a program is compiled in seconds, so that a law gets more than two."""


def of_scenario(scenario: Scenario, compared: Sequence[str] = (), rate: bool = False) -> dict[str, Any]:
    """The manifest of one scenario.

    - `compared`: names of schemes to compare, and `printed` for the law as printed.
    - `rate`: compute `loop_rate` for any number of joints, which may take minutes.

    Raises DefinitionError if there is no such scheme, or the scenario cannot run in a page.
    """
    description = scenario.description
    own, *others = settings_of(description, scenario.robot, compared, choices=_choices(description))
    settings = [replace(own, rate=rate), *others]
    return playground(description.title, settings, {scenario.robot: scenario.robot.replace("_", " ")})


def _choices(description: ScenarioDescription) -> list[Choice]:
    """Other periods and delays, for a sampled-data law."""
    simulation, delay = description.simulation, description.sensor.delay
    if description.scheme.sampled_data is None:
        return []
    # Periods share a program; delays need their own.
    delays = {0.0, 1.0, delay} if len(description.start.q) <= FEW else {0.0, delay or 1.0}
    periods = (simulation.period / 2, simulation.period, simulation.period * 2)
    whole = round(simulation.t1 / simulation.period) % 2 == 0
    return [
        Choice("simulation.period", "sampling period", "s", periods if whole else periods[:2]),
        Choice("sensor.delay", "age of a measurement when it arrives", "periods", tuple(sorted(delays))),
    ]


def write_page(manifest: Mapping[str, Any], out: Path) -> Path:
    """Write the page of a manifest to the folder `out`; return its path.

    Raises DefinitionError if it cannot be written.
    """
    from .page_text import page_text

    page = out / PAGE_FILE
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_text(page, page_text(manifest))
    except OSError as error:
        raise DefinitionError(f"cannot write the page to `{out}`: {reason(error)}") from None
    return page
