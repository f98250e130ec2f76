"""Tasks of the benchmark: an arm, its motion, its uncertainty, and the tolerance band that judges all schemes."""

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
"""Version of the tasks, the tuned gains and the rules; results of different versions are not compared."""

FOLDER = resources.files("slidax.league") / "tasks"


class CasesDescription(AbstractDescription):
    """Random cases."""

    cases: int = said("number of cases", "", "[1, 1e6]")
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """Another seed draws other cases."""


class BenchmarkTask(AbstractDescription):
    """A task, the same for all schemes."""

    title: str
    """One line for a person."""
    about: list[str]
    """The difficulties of the task."""
    source: str
    """Source of the numbers."""
    scenario: dict[str, Any]
    """A scenario without a scheme."""
    sampled_data: dict[str, Any] = Field(default={})
    """The block `sampled_data` of every scheme in that form."""
    tolerance: dict[str, Any]
    """Judges the errors, as the block `tolerance` of a scenario; also the envelope of every scheme that has one."""
    uncertainty: Uncertainty
    """Unknown to every law, as in a scenario."""
    training: CasesDescription
    """Cases for the tuner."""
    held_out: CasesDescription
    """Cases for the score."""


def names() -> list[str]:
    """List the names of the tasks."""
    return sorted(Path(entry.name).stem for entry in FOLDER.iterdir() if entry.name.endswith(".yaml"))


def task(name: str) -> BenchmarkTask:
    """Return a task by its `name`.

    Raises DefinitionError if the task does not exist, or if its file is invalid.
    """
    if name not in names():
        raise DefinitionError(f"there is no task `{name}`; {nearest(name, names())}")
    data = read_yaml((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
    with located(name):
        try:
            return BenchmarkTask.model_validate(data)
        except ValidationError as error:
            raise translated(error, data) from None
