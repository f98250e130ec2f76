"""The worst that a scenario's uncertainty allows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, nearest, plain
from slidax.reports import write_scenario
from slidax.scenarios.base import said
from slidax.scenarios.family import Family

from .asked import Asked
from .search import Found, lowest
from .study import AbstractStudy, How
from .table import OUTCOMES, Columns

MARGIN = "margin"

WORSE = 1e9
"""What a run that ended early counts for where a metric is searched, as it would have gone on getting worse."""


class Falsify(AbstractStudy):
    """Searches all that may be for the least margin, or for the worst of a metric."""

    study: Literal["falsify"]
    runs: int = said("at most so many", "", "[1, 1e9]", default=3000)
    seconds: float | None = said(
        "after so many no batch begins; the rows then depend on the machine", "s", "> 0", default=None
    )
    worst: str = MARGIN
    """Of what the worst is searched: `margin`, or a metric such as `steady_error`."""
    until: Literal["violation"] | None = None
    """`violation` stops at the first run outside its envelope; else all runs are used to find the worst."""
    keep: Annotated[int, Field(ge=1, le=100)] = 3
    """How many of the worst cases are written as scenarios, each apart from the others."""
    apart: float = said("by what share of its set at least one number of theirs differs", "", "(0, 1]", default=0.25)

    def run(self, how: How) -> FalsifyResult:
        """The worst cases.

        - `how`: where, and what is told on the way.
        """
        family = self.family()
        self.require(
            bool(family.space.sets), "uncertainty", "is empty: there is nothing to search; write what is not known"
        )
        self.require(
            self.until is None or self.worst == MARGIN,
            "until",
            f"is for `worst: {MARGIN}`, where 0 is the envelope's bound",
        )
        runner = self.runner(family, how)
        asked = Asked(runner, family.space)
        how.begin(self.runs)
        found = lowest(
            lambda cube: badness(asked.points(cube), self.worst),
            family.space.dimensions,
            evaluations=self.runs,
            seed=self.seed,
            seconds=self.seconds,
            enough=0.0 if self.until else None,
            keep=self.keep,
            distance=self.apart,
        )
        table = asked.table
        values = badness(table, self.worst)
        rows = [int(np.flatnonzero(values == value)[0]) for value in found.values]
        files = _written(family, asked, rows, how.out)
        return FalsifyResult(
            self, family, table, found, tuple(rows), files, asked.finish(), runner.computed, runner.seconds
        )


def badness(columns: Columns, of: str) -> np.ndarray:
    """One number for each row, the lower the worse.

    - `columns`: outcome and metrics.
    - `of`: `margin`, or the key of a metric.

    Raises DefinitionError if there is no such metric, or no row has it.
    """
    if of not in columns:
        raise DefinitionError(f"there is no metric `{plain(of)}`; {nearest(of, columns)}", where="worst")
    value, bad = np.asarray(columns[of], float), np.asarray(columns["outcome"]) > 0
    if not np.isfinite(value).any() and not bad.any():
        remedy = "search for `worst: steady_error`" if of == MARGIN else "search for another"
        raise DefinitionError(f"no run has a number for `{of}`: {remedy}", where="worst")
    if of == MARGIN:
        return np.where(np.isfinite(value), value, np.where(bad, -2.0, np.inf))
    ended = (columns["outcome"] == OUTCOMES.index("left_envelope")) | (
        columns["outcome"] == OUTCOMES.index("not_finite")
    )
    early = -WORSE + np.nan_to_num(columns["t"])
    return np.where(ended, early, np.where(np.isfinite(value), -value, np.inf))


def _written(family: Family, asked: Asked, rows: list[int], out: Path | None) -> tuple[Path, ...]:
    if out is None:
        return ()
    paths = [out / f"worst-{number}.yaml" for number in range(1, len(rows) + 1)]
    for path, row in zip(paths, rows, strict=True):
        case = family.case(asked.values_of(row))
        write_scenario(case.model_copy(update={"title": f"{case.title} - row {row}"}), path)
    return tuple(paths)


@dataclass(frozen=True)
class FalsifyResult:
    """What a search for the worst found.

    - `study`, `family`: what was asked.
    - `table`: the rows, in the order in which they were asked for.
    - `found`: the worst points of the unit cube.
    - `rows`: the numbers of their rows.
    - `files`: their scenarios; none if the rows are not kept.
    - `path`: of the table; None if it was not kept.
    - `computed`, `seconds`: rows that were not stored before, and the time that they took.
    """

    study: Falsify
    family: Family
    table: Columns
    found: Found
    rows: tuple[int, ...]
    files: tuple[Path, ...]
    path: Any
    computed: int
    seconds: float

    @property
    def runs(self) -> int:
        """How many there were."""
        return len(self.table["row"])

    @property
    def failures(self) -> int:
        """How many of the runs failed; it says nothing of a probability, as the search goes where they are."""
        return int(np.sum(self.table["outcome"] > 0))

    @property
    def ended(self) -> str:
        """Why the search ended."""
        return {
            "enough": f"a violation was found in run {self.runs}",
            "seconds": f"the time was over after {self.runs} runs",
        }.get(self.found.stop, f"all {self.runs} runs are done")

    def case(self, place: int) -> dict[str, Any]:
        """One of the worst cases, for a program.

        - `place`: 0 is the worst.
        """
        row = self.rows[place]
        margin = float(self.table[MARGIN][row])
        said: dict[str, Any] = {"row": row, "margin": margin if np.isfinite(margin) else None}
        if self.study.worst != MARGIN:
            value = float(self.table[self.study.worst][row])
            said[self.study.worst] = value if np.isfinite(value) else None
        said["outcome"] = OUTCOMES[int(self.table["outcome"][row])]
        said["scenario"] = str(self.files[place]) if self.files else None
        return said

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        cases = [self.case(place) for place in range(len(self.rows))]
        return {
            "kind": "falsify",
            "runs": self.runs,
            "failures": self.failures,
            "probability": None,
            "ended": self.ended,
            "worst": cases[0] if cases else None,
            "found": cases,
            "history": self.found.history.tolist(),
        }
