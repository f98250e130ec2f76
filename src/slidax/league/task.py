"""A task of the league: an arm, its motion, what is not known of it, and the tolerance band that judges."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from slidax._errors import DefinitionError, located, nearest
from slidax.scenarios.base import AbstractDescription, said
from slidax.scenarios.mistakes import translated
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.scenarios.yaml_text import read_yaml

VERSION = 1
"""Of the tasks, of what is tuned, and of how it is judged: another number where any of them has changed."""

FOLDER = resources.files("slidax.league") / "tasks"


class CasesDescription(AbstractDescription):
    """Cases that are drawn."""

    cases: int = said("how many", "", "[1, 1e6]")
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """Another seed draws others."""


class LeagueTask(AbstractDescription):
    """What all schemes are asked alike."""

    title: str
    """One line for a person."""
    about: list[str]
    """What is hard about it."""
    source: str
    """Where the numbers come from."""
    scenario: dict[str, Any]
    """A scenario without a scheme."""
    sampled_data: dict[str, Any] = Field(default={})
    """The block `sampled_data` of every scheme in that form."""
    tolerance: dict[str, Any]
    """What judges, as the block `tolerance` of a scenario; also the envelope of every scheme that draws one."""
    uncertainty: Uncertainty
    """What no law knows, as in a scenario."""
    training: CasesDescription
    """What the tuner sees."""
    held_out: CasesDescription
    """What the score is of."""


def names() -> list[str]:
    """The names of the tasks."""
    return sorted(Path(entry.name).stem for entry in FOLDER.iterdir() if entry.name.endswith(".yaml"))


def task(name: str) -> LeagueTask:
    """A task by its name.

    - `name`: of a task of the league.

    Raises DefinitionError if there is none, or something in it is invalid.
    """
    if name not in names():
        raise DefinitionError(f"there is no task `{name}`; {nearest(name, names())}")
    data = read_yaml((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
    with located(name):
        try:
            return LeagueTask.model_validate(data)
        except ValidationError as error:
            raise translated(error, data) from None
