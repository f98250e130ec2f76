"""The base of all studies and results: a scenario, its uncertainty, a seed, and the options of a run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field

from slidax.core.errors import DefinitionError, locate_errors
from slidax.scenarios.descriptions import AbstractDescription
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description, read_description
from slidax.scenarios.scenario import ScenarioDescription
from slidax.scenarios.uncertainty import AbstractSet, Uncertainty

from .cases import COLUMNS, Columns, StudyTask
from .runner import AbstractPool, LocalPool, Part, Runner, ignore_progress
from .statistics import Interval
from .store import Store

NO_WORST_CASE: dict[str, Any] = {"row": None, "margin": None, "scenario": None}
"""Worst case in the JSON of a study that has none."""

Cell: TypeAlias = str | float | int | None
"""Text or a number of a table; None is shown as a dash."""

ChartKind = Literal[
    "histograms",
    "intervals",
    "margin_over",
    "parameter_map",
    "pareto_front",
    "search_history",
    "variance_shares",
]
"""Names of the functions in `slidax.report.figures` that draw charts."""


@dataclass(frozen=True)
class Chart:
    """A figure as data, for `slidax.report` to draw.

    - `name`: name of its file, without suffix.
    - `title`, `caption`: texts next to it.
    - `kind`, `values`: name of the function in `slidax.report.figures` that draws the chart, and its arguments.
    """

    name: str
    title: str
    caption: str
    kind: ChartKind
    values: tuple[Any, ...]


@dataclass(frozen=True)
class Section:
    """A part of a study's page, and of its output in a terminal, which leaves out the figures.

    - `title`, `note`: the title, and a sentence or two below it.
    - `head`, `rows`: titles and rows of the table; an empty head for no table.
    - `figures`: charts below the table.
    """

    title: str
    note: str = ""
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Cell]] = ()
    figures: Sequence[Chart] = field(default=())


@dataclass(frozen=True, kw_only=True)
class AbstractResult(ABC):
    """Base of the results of studies.

    - `family`: the scenarios of all runs: a scenario with a set of values for each uncertain or varied path.
    - `path`: file or folder of the rows; None if they were not stored.
    - `computed`, `seconds`: number of newly computed rows, and their computing time.
    """

    family: Family
    path: Any
    computed: int
    seconds: float

    @property
    @abstractmethod
    def summary(self) -> str:
        """The result in a sentence."""

    @property
    @abstractmethod
    def good(self) -> bool:
        """True if nothing failed."""

    @abstractmethod
    def sections(self) -> list[Section]:
        """Return the sections of the result's page."""

    @abstractmethod
    def as_json(self) -> dict[str, Any]:
        """Return the result as plain values for JSON."""

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """Return scenarios for `slidax run`, such as the worst case, by the names of their files without suffix."""
        return {}


@dataclass(frozen=True, kw_only=True)
class AbstractTableResult(AbstractResult):
    """Base of the results of studies with a single table.

    - `study`: the study.
    - `table`: columns by name, with a row for each run: values, outcome and metrics.
    """

    study: Any
    table: Columns

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.table["row"])

    @property
    def failures(self) -> int:
        """Number of runs whose outcome is not `ok`; it estimates no probability if a search chose the runs."""
        return int(np.sum(self.table["outcome"] > 0))

    @property
    def good(self) -> bool:
        """True if the outcome of every run is `ok`."""
        return not self.failures


def all_done(runs: int) -> str:
    """Return the sentence “all N runs are done” for a number of `runs`."""
    return "the run is done" if runs == 1 else f"all {runs} runs are done"


def worst_row(table: Columns) -> dict[str, Any]:
    """Return number and margin of the row with the least envelope margin, for JSON; both None without an envelope."""
    margin = table["margin"]
    if not np.isfinite(margin).any():
        return NO_WORST_CASE
    row = int(np.nanargmin(margin))
    return {"row": row, "margin": float(margin[row]), "scenario": None}


def interval_of(interval: Interval | None) -> dict[str, float] | None:
    """Return an interval as a mapping for JSON; None for None."""
    if interval is None:
        return None
    return {"lower": interval.lower, "upper": interval.upper, "confidence": interval.confidence}


Progress = Callable[[int], None]


@dataclass
class RunOptions:
    """Options for running a study.

    - `out`: folder for the rows; None keeps them in memory.
    - `resume`: True to continue with the rows in `out`.
    - `pool`: computes the rows.
    - `begin`: called once, with the largest number of rows that the study can need.
    - `progress`: called with the number of new rows, after each chunk.
    - `made_by`: software and machine, recorded in the folder.
    - `part`: the chunks to compute here, in a folder shared with other processes; None for all.
    """

    out: str | Path | None = None
    resume: bool = False
    pool: AbstractPool = field(default_factory=LocalPool)
    begin: Progress = ignore_progress
    progress: Progress = ignore_progress
    made_by: dict[str, Any] = field(default_factory=dict)
    part: Part | None = None


class AbstractStudy(AbstractDescription):
    """Base of all studies: many runs of a scenario, described by a study file."""

    of_rows: ClassVar[tuple[str, ...]] = ("seed",)
    """Names of the fields that determine the cases, in addition to the scenario and its sets."""
    in_parts: ClassVar[bool] = False
    """True if the values of all rows are known in advance, so that several processes can share the rows."""
    study: Any
    title: str = ""
    """Title in one line."""
    scenario: str
    """Name of a built-in scenario, or path of a file, relative to the study's folder."""
    changes: dict[str, Any] = Field(default={})
    """Changed values of the scenario by dotted path, as with `--set`."""
    uncertainty: Uncertainty = Field(default={})
    """Sets of uncertain values by path, in addition to the scenario's sets."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Seed of the random cases."""
    engine: Literal["auto", "native", "xla", "cuda"] | None = None
    """Engine that simulates; by default the scenario's own."""

    @abstractmethod
    def run(self, how: RunOptions) -> AbstractResult:
        """Run the study, and return its result.

        - `how`: folder, pool and progress.
        """

    def described(self) -> ScenarioDescription:
        """Return the scenario's description with the study's changes."""
        with locate_errors("scenario"):
            base = read_description(self.scenario)
        if not self.changes:
            return base
        with locate_errors("changes"):
            return alter_description(base, self.changes)

    def sets(self, base: ScenarioDescription) -> dict[str, AbstractSet]:
        """Return the sets of uncertain values by path: the scenario's own, replaced or extended by the study's.

        - `base`: description of the scenario.
        """
        return {**base.uncertainty, **self.uncertainty}

    def family(self, varied: dict[str, AbstractSet] | None = None) -> Family:
        """Return the family of scenarios that the study runs.

        - `varied`: sets, by path, of values that the study varies and the law knows, such as its gains.

        Raises DefinitionError, with the path, if a set is empty or a value is out of range.
        """
        base = self.described()
        return Family.of(base, self.sets(base), varied or {})

    def runner(self, family: Family, how: RunOptions) -> Runner:
        """Return the runner that computes the study's rows, or reads them from the folder `how.out`.

        - `family`: the family of scenarios to run.
        - `how`: as in `run`.

        Raises DefinitionError as `require_parts`, and as `Store` for the folder.
        """
        self.require_parts(how)
        task = StudyTask.of(family, self.engine)
        simulation = family.base.simulation
        chunk = Runner.rows_of_chunk(round(simulation.t1 / simulation.period))
        store = None
        if how.out is not None:
            text = self.model_dump(mode="json", include={"study", *self.of_rows})
            identity = {**text, **task.content, "chunk": chunk, "made_by": how.made_by}
            # A process that computes a part continues the folder of the others.
            store = Store(Path(how.out), identity, resume=how.resume or how.part is not None, notes=COLUMNS)
        return Runner(task, chunk, store, how.pool, how.progress, how.part)

    def require_parts(self, how: RunOptions) -> None:
        """Raise DefinitionError if `how.part` is set, but the study cannot be shared or has no folder.

        - `how`: as in `run`.
        """
        if how.part is None:
            return
        if how.out is None:
            raise DefinitionError("`--part` needs the folder that the processes share: --out DIR")
        if not self.in_parts or getattr(self, "until", None) is not None:
            kind = self.study if not self.in_parts else f"{self.study} with `until`"
            raise DefinitionError(
                f"`--part` is for studies whose rows are known in advance, but the rows of {kind} depend on earlier "
                "results: leave `--part` out, or use --cluster"
            )

    def require(self, holds: bool, where: str, message: str) -> None:
        """Raise DefinitionError for a field of the study unless a condition holds.

        - `holds`: the condition.
        - `where`: path of the field.
        - `message`: text of the error: the rule, the value and the remedy.
        """
        if not holds:
            raise DefinitionError(message, where=where)
