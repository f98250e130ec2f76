"""Searches for the worst case that a scenario's uncertainty allows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax.core.errors import DefinitionError, count_noun, percent
from slidax.core.files import json_value
from slidax.scenarios.descriptions import input_field
from slidax.scenarios.scenario import ScenarioDescription

from .cases import LARGER_IS_BETTER, OUTCOMES, Columns, require_metric
from .overview import overview
from .runner import BatchEvaluator
from .search import SearchResult, search_lowest
from .study import NO_WORST_CASE, AbstractStudy, AbstractTableResult, Cell, Chart, RunOptions, Section, all_done

MARGIN = "margin"

WORSE = 1e9
"""Penalty of a run that ended early, in a search over a metric."""


class Falsify(AbstractStudy):
    """Searches the uncertainty sets for the least margin, or for the worst value of a metric."""

    study: Literal["falsify"]
    runs: int = input_field("largest number of runs", "", "[1, 1e9]", default=3000)
    seconds: float | None = input_field(
        "time after which no batch begins; the rows then depend on the machine", "s", "> 0", default=None
    )
    worst: str = MARGIN
    """Searched quantity: `margin`, or a metric such as `steady_error`."""
    until: Literal["violation"] | None = None
    """`violation` stops at the first run outside its envelope; otherwise the search uses all runs."""
    keep: Annotated[int, Field(ge=1, le=100)] = 3
    """Number of distinct worst cases to write as scenarios."""
    apart: float = input_field(
        "share of its set by which at least one value must differ between two worst cases", "", "(0, 1]", default=0.25
    )

    def run(self, how: RunOptions) -> FalsifyResult:
        family = self.family()
        self.require(
            bool(family.space.sets),
            "uncertainty",
            "is empty: there is nothing to search; give sets of uncertain values",
        )
        self.require(
            self.until is None or self.worst == MARGIN,
            "until",
            f"is for `worst: {MARGIN}`, where a violation is a margin < 0: leave out `until`",
        )
        evaluated = BatchEvaluator(self.runner(family, how), family)
        how.begin(self.runs)
        search = search_lowest(
            lambda cube: rank_badness(evaluated.points(cube), self.worst),
            family.space.dimensions,
            evaluations=self.runs,
            seed=self.seed,
            seconds=self.seconds,
            enough=0.0 if self.until else None,
            keep=self.keep,
            distance=self.apart,
        )
        values = rank_badness(evaluated.table, self.worst)
        rows = [int(np.flatnonzero(values == value)[0]) for value in search.values]
        return FalsifyResult(
            study=self,
            **evaluated.collected(),
            search=search,
            rows=tuple(rows),
            cases=tuple(evaluated.values_of(row) for row in rows),
        )


def rank_badness(columns: Columns, of: str) -> np.ndarray:
    """Return a number for each row, which is lower for a worse row [rows].

    The number is the margin, the metric, or the negative of a metric whose smaller values are better. A row without a
    value gets +∞ if it did not fail.

    - `columns`: table with outcome and metrics of the rows.
    - `of`: `margin`, or the key of a metric. With a metric, rows that ended early are worse than all others.

    Raises DefinitionError if there is no such metric, or no row has a value for it.
    """
    require_metric(of, columns, "worst")
    value, bad = np.asarray(columns[of], float), np.asarray(columns["outcome"]) > 0
    if not np.isfinite(value).any() and not bad.any():
        remedy = "search for `worst: steady_error`" if of == MARGIN else "search for another metric"
        raise DefinitionError(f"no run has a value for `{of}`: {remedy}", where="worst")
    if of == MARGIN:
        return np.where(np.isfinite(value), value, np.where(bad, -2.0, np.inf))
    ended = (columns["outcome"] == OUTCOMES.index("left_envelope")) | (
        columns["outcome"] == OUTCOMES.index("not_finite")
    )
    early = -WORSE + np.nan_to_num(columns["t"])
    return np.where(ended, early, np.where(np.isfinite(value), _sign(of) * value, np.inf))


def _sign(of: str) -> float:
    return 1.0 if of in LARGER_IS_BETTER else -1.0


@dataclass(frozen=True)
class FalsifyResult(AbstractTableResult):
    """Result of a search for the worst case.

    - `search`: the worst points of the unit cube, with their numbers from `rank_badness`.
    - `rows`: row number of each worst point.
    - `cases`: uncertain values of each worst point, by dotted path.
    """

    study: Falsify
    search: SearchResult
    rows: tuple[int, ...]
    cases: tuple[dict[str, Any], ...]

    @property
    def ended(self) -> str:
        """The reason for the end of the search, in words."""
        return {
            "enough": f"a violation was found in run {self.runs}",
            "seconds": f"the time limit ended the search after {count_noun(self.runs, 'run')}",
        }.get(self.search.stop, all_done(self.runs))

    @property
    def summary(self) -> str:
        if not self.rows:
            return f"No run has a value for `{self.study.worst}` ({self.ended})."
        outcome = OUTCOMES[int(self.table["outcome"][self.rows[0]])].replace("_", " ")
        value = float(self.table[self.study.worst][self.rows[0]])
        number = "without a value" if not np.isfinite(value) else f"{value:.4g}"
        failed = "no run failed" if self.good else f"{count_noun(self.failures, 'run')} failed"
        worst = f"the worst {self.study.worst} is {number}, {outcome}"
        return f"{count_noun(self.runs, 'run')}, {failed}: {worst} ({self.ended})."

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files of the worst cases, the worst first."""
        return tuple("worst" if index == 0 else f"worst-{index + 1}" for index in range(len(self.rows)))

    def scenarios(self) -> dict[str, ScenarioDescription]:
        return {name: self.family.case(case) for name, case in zip(self.names, self.cases, strict=True)}

    def sections(self) -> list[Section]:
        head = ["File", self.study.worst, *(["Margin"] if self.study.worst != MARGIN else []), "Outcome", "Row"]
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
        history = self.search.history * np.array([1.0, _sign(self.study.worst)])
        # A run that ended early has no value of its own.
        history = history[np.abs(history[:, 1]) < 0.5 * WORSE]
        label = f"worst {self.study.worst.replace('_', ' ')}"
        bound = 0.0 if self.study.worst == MARGIN else None
        chart = Chart("search", "The search", "The worst value so far.", "search_history", (history, label, bound))
        note = f"Any two of them differ in at least one value, by {percent(self.study.apart)} of its set or more."
        worst = Section("The worst cases", note, head, rows, [chart])
        if not self.rows:
            return [worst]
        return [worst, *overview(self.family, self.table, self.cases[0], self.rows[0])[1:]]

    def _case_as_json(self, index: int) -> dict[str, Any]:
        row = self.rows[index]
        case: dict[str, Any] = {"row": row}
        for key in dict.fromkeys([MARGIN, self.study.worst]):
            case[key] = json_value(float(self.table[key][row]))
        return {**case, "outcome": OUTCOMES[int(self.table["outcome"][row])], "scenario": f"{self.names[index]}.yaml"}

    def as_json(self) -> dict[str, Any]:
        cases = [self._case_as_json(index) for index in range(len(self.rows))]
        return {
            "kind": "falsify",
            "runs": self.runs,
            "failures": self.failures,
            "probability": None,
            "ended": self.ended,
            "worst": {**cases[0], "scenario": None} if cases else NO_WORST_CASE,
            "found": cases,
            "history": self.search.history.tolist(),
        }
