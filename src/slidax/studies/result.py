"""Results of studies as data: a sentence, sections with tables and charts, JSON, and scenarios."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.family import Family

from .statistics import Interval
from .table import Columns

NOTHING: dict[str, Any] = {"row": None, "margin": None, "scenario": None}
"""The worst case of a study without one."""

Cell: TypeAlias = str | float | int | None
"""Text or a number of a table; None is shown as a dash."""

ChartKind = Literal[
    "aims_front",
    "histograms",
    "intervals",
    "margin_over",
    "parameter_map",
    "search_history",
    "variance_shares",
]
"""Names of functions in `slidax.figures`."""


@dataclass(frozen=True)
class Drawn:
    """A figure as data, for `slidax.reports` to draw.

    - `name`: of its file, without ending.
    - `title`, `caption`: texts next to it.
    - `kind`: the function of `slidax.figures` that draws it; `values`: its arguments.
    """

    name: str
    title: str
    caption: str
    kind: ChartKind
    values: tuple[Any, ...]


@dataclass(frozen=True)
class Section:
    """A part of a study's page, and of its output in a terminal, which leaves out the figures.

    - `title`, `note`: a few words, and a sentence or two.
    - `head`, `rows`: of the table; no head for no table.
    - `figures`: below the table.
    """

    title: str
    note: str = ""
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Cell]] = ()
    figures: Sequence[Drawn] = field(default=())


@dataclass(frozen=True, kw_only=True)
class AbstractResult(ABC):
    """Result of a study.

    - `family`: the scenarios of its runs.
    - `path`: of the rows' file or folder; None if they were not kept.
    - `computed`, `seconds`: number of rows that were not stored before, and the time that they took.
    """

    family: Family
    path: Any
    computed: int
    seconds: float

    @property
    @abstractmethod
    def lead(self) -> str:
        """The answer in a sentence."""

    @property
    @abstractmethod
    def good(self) -> bool:
        """True if nothing failed."""

    @abstractmethod
    def sections(self) -> list[Section]:
        """Return the parts of its page."""

    @abstractmethod
    def as_json(self) -> dict[str, Any]:
        """Return the result for a program."""

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """Return scenarios that `slidax run` replays, by the names of their files without ending."""
        return {}


@dataclass(frozen=True, kw_only=True)
class AbstractTableResult(AbstractResult):
    """Result of a study with one table of rows.

    - `study`: the request.
    - `table`: the rows.
    """

    study: Any
    table: Columns

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.table["row"])

    @property
    def failures(self) -> int:
        """Number of runs that failed; no estimate of a probability where a search chose the runs."""
        return int(np.sum(self.table["outcome"] > 0))

    @property
    def good(self) -> bool:
        """True if no run failed."""
        return not self.failures


def all_done(runs: int) -> str:
    """Return the sentence that no run is missing."""
    return "the run is done" if runs == 1 else f"all {runs} runs are done"


def worst_of(table: Columns) -> dict[str, Any]:
    """Return the row with the least margin, for a program."""
    margin = table["margin"]
    if not np.isfinite(margin).any():
        return NOTHING
    row = int(np.nanargmin(margin))
    return {"row": row, "margin": float(margin[row]), "scenario": None}


def interval_of(interval: Interval | None) -> dict[str, float] | None:
    """Return an interval for a program."""
    if interval is None:
        return None
    return {"lower": interval.lower, "upper": interval.upper, "confidence": interval.confidence}
