"""Metadata of a log: all that is needed to replay it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import slidax
from slidax.logs import LogWriter
from slidax.logs.writer import SCENARIO
from slidax.scenarios import portable

from .lockstep import Stepped

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

CHUNK = 500
"""Ticks that are compressed together."""


def attachments_of(scenario: Scenario) -> dict[str, bytes]:
    """The scenario, and the files that it names; changes by `replace` are not in its description."""
    text, files = portable(scenario.description)
    return {SCENARIO: text.encode(), **files}


def metadata_of(scenario: Scenario, made_by: str, seconds: float) -> dict[str, str]:
    """Metadata of a log.

    - `made_by`: "run" or "loop".
    - `seconds`: planned duration.
    """
    return {
        "slidax": slidax.__version__,
        "scenario": scenario.name,
        "scheme": scenario.scheme,
        "robot": scenario.robot,
        "made_by": made_by,
        "period_s": repr(scenario.period),
        "seconds": repr(seconds),
    }


def write_stepped(scenario: Scenario, stepped: Stepped, path: Path) -> None:
    """Write a loop without a clock as an MCAP file, with time 0 as start.

    Raises DefinitionError if foxglove-sdk is not installed, OSError if the file cannot be written.
    """
    seconds = float(stepped.arm["true_t"][-1])
    metadata, attachments = metadata_of(scenario, "run", seconds), attachments_of(scenario)
    with closing(LogWriter(path, stepped.channels, metadata, attachments)) as writer:
        for first in range(0, len(stepped.arm["true_t"]), CHUNK):
            ticks = stepped.arm["true_k"][first : first + CHUNK]
            answered = (stepped.law["k"] >= ticks[0]) & (stepped.law["k"] <= ticks[-1])
            writer.law({name: column[answered] for name, column in stepped.law.items()})
            writer.arm({name: column[first : first + CHUNK] for name, column in stepped.arm.items()})
            writer.flush()
