"""What every study finds, in the form that a terminal, a page and a program ask for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from slidax.scenarios.description import ScenarioDescription

from .statistics import Interval
from .table import Columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTHING: dict[str, Any] = {"row": None, "margin": None, "scenario": None}
"""The worst case of a study that has none."""

Cell: TypeAlias = str | float | int | None
"""Of a table: text, or a number; None is shown as a dash."""


@dataclass(frozen=True)
class Drawn:
    """A figure with what is said of it.

    - `name`: of its file, without ending.
    - `title`: a few words.
    - `caption`: what is seen.
    - `figure`: the figure.
    """

    name: str
    title: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Section:
    """A part of a study's page, and of what the terminal prints.

    - `title`: a few words.
    - `note`: a sentence or two; may be empty.
    - `head`: of the table's columns; none for no table.
    - `rows`: of the table.
    - `figures`: drawn below; the terminal leaves them out.
    """

    title: str
    note: str = ""
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Cell]] = ()
    figures: Sequence[Drawn] = field(default=())


class AbstractResult(ABC):
    """What a study found."""

    @property
    @abstractmethod
    def lead(self) -> str:
        """The answer in a sentence."""

    @property
    @abstractmethod
    def good(self) -> bool:
        """Whether nothing failed."""

    @abstractmethod
    def sections(self) -> list[Section]:
        """The parts of its page."""

    @abstractmethod
    def as_json(self) -> dict[str, Any]:
        """The result for a program."""

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """Scenarios that `slidax run` replays, by the names of their files without ending."""
        return {}


def all_done(runs: int) -> str:
    """The sentence that no run is missing.

    - `runs`: how many there were.
    """
    return "the run is done" if runs == 1 else f"all {runs} runs are done"


def worst_of(table: Columns) -> dict[str, Any]:
    """The row with the least margin, for a program.

    - `table`: the rows.
    """
    margin = table["margin"]
    if not np.isfinite(margin).any():
        return NOTHING
    row = int(np.nanargmin(margin))
    return {"row": row, "margin": float(margin[row]), "scenario": None}


def interval_of(one: Interval | None) -> dict[str, float] | None:
    """An interval, for a program.

    - `one`: the interval.
    """
    return None if one is None else {"lower": one.lower, "upper": one.upper, "confidence": one.confidence}
