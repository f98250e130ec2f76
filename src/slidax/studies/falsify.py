"""The worst that a scenario's uncertainty allows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, counted, nearest, plain
from slidax.scenarios.base import said
from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.family import Family

from .asked import Asked
from .overview import overview
from .result import NOTHING, AbstractResult, Cell, Drawn, Section, all_done
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
        return FalsifyResult(
            study=self,
            family=family,
            table=table,
            found=found,
            rows=tuple(rows),
            cases=tuple(asked.values_of(row) for row in rows),
            path=asked.finish(),
            computed=runner.computed,
            seconds=runner.seconds,
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


@dataclass(frozen=True)
class FalsifyResult(AbstractResult):
    """What a search for the worst found.

    - `study`, `family`: what was asked.
    - `table`: the rows, in the order in which they were asked for.
    - `found`: the worst points of the unit cube.
    - `rows`: the numbers of their rows.
    - `cases`: their values, by path.
    - `path`: of the table; None if it was not kept.
    - `computed`, `seconds`: rows that were not stored before, and the time that they took.
    """

    study: Falsify
    family: Family
    table: Columns
    found: Found
    rows: tuple[int, ...]
    cases: tuple[dict[str, Any], ...]
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
            "seconds": f"the time was over after {counted(self.runs, 'run')}",
        }.get(self.found.stop, all_done(self.runs))

    @property
    def good(self) -> bool:
        """Whether no run failed."""
        return not self.failures

    @property
    def lead(self) -> str:
        """The answer in a sentence."""
        if not self.rows:
            return f"No run has a number for `{self.study.worst}` ({self.ended})."
        outcome = OUTCOMES[int(self.table["outcome"][self.rows[0]])].replace("_", " ")
        value = float(self.table[self.study.worst][self.rows[0]])
        said = "without a number" if not np.isfinite(value) else f"{value:.4g}"
        found = "no run failed" if self.good else f"{counted(self.failures, 'run')} failed"
        return (
            f"{counted(self.runs, 'run')}, {found}: the worst {self.study.worst} is {said}, {outcome} ({self.ended})."
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Of the files of the worst cases, the worst first."""
        return tuple("worst" if place == 0 else f"worst-{place + 1}" for place in range(len(self.rows)))

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """The worst cases."""
        return {name: self.family.case(case) for name, case in zip(self.names, self.cases, strict=True)}

    def sections(self) -> list[Section]:
        """The worst cases, the way of the search, what the margin depends on, and the worst case's values."""
        from slidax.figures import search_history

        head = ["File", self.study.worst, *(["margin"] if self.study.worst != MARGIN else []), "outcome", "row"]
        rows: list[list[Cell]] = [
            [
                f"{name}.yaml",
                float(self.table[self.study.worst][row]),
                *([float(self.table[MARGIN][row])] if self.study.worst != MARGIN else []),
                OUTCOMES[int(self.table["outcome"][row])].replace("_", " "),
                row,
            ]
            for name, row in zip(self.names, self.rows, strict=True)
        ]
        sign = 1.0 if self.study.worst == MARGIN else -1.0
        history = self.found.history * np.array([1.0, sign])
        # A run that ended early has no number of its own.
        history = history[np.abs(history[:, 1]) < 0.5 * WORSE]
        label = f"worst {self.study.worst.replace('_', ' ')}"
        bound = 0.0 if self.study.worst == MARGIN else None
        way = Drawn("search", "The search", "The worst so far.", search_history(history, label, bound))
        note = f"Each differs from the others by {self.study.apart:.0%} of its set in one number at least."
        worst = Section("The worst cases", note, head, rows, [way])
        if not self.rows:
            return [worst]
        return [worst, *overview(self.family, self.table, self.cases[0], self.rows[0])[1:]]

    def _said(self, place: int) -> dict[str, Any]:
        row = self.rows[place]
        said: dict[str, Any] = {"row": row}
        for key in dict.fromkeys([MARGIN, self.study.worst]):
            value = float(self.table[key][row])
            said[key] = value if np.isfinite(value) else None
        return {**said, "outcome": OUTCOMES[int(self.table["outcome"][row])], "scenario": f"{self.names[place]}.yaml"}

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        cases = [self._said(place) for place in range(len(self.rows))]
        return {
            "kind": "falsify",
            "runs": self.runs,
            "failures": self.failures,
            "probability": None,
            "ended": self.ended,
            "worst": {**cases[0], "scenario": None} if cases else NOTHING,
            "found": cases,
            "history": self.found.history.tolist(),
        }
