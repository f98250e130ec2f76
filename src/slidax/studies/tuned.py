"""Result of a search for gains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax._errors import counted
from slidax.metrics import METRICS
from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.load import altered_description

from .overview import share
from .predicate import Predicate
from .result import NOTHING, AbstractResult, Cell, Drawn, Section, interval_of
from .search import Front
from .statistics import Interval, PairedDifference, clopper_pearson, paired_difference
from .table import Columns


def rows_of(columns: Columns, first: int, last: int | None) -> Columns:
    """Some rows of a table.

    - `columns`: the table.
    - `first`: number of the first one.
    - `last`: number of the one after the last; None: all that follow.
    """
    return {name: array[first:last] for name, array in columns.items()}


@dataclass(frozen=True)
class Candidate:
    """Score of gains on held-out cases.

    - `aims`: the mean of each metric, by its key.
    - `failures`, `runs`: in how many of the cases something did not hold.
    - `holding`: interval of the probability that all holds.
    """

    aims: dict[str, float]
    failures: int
    runs: int
    holding: Interval


@dataclass(frozen=True)
class Tuned(AbstractResult):
    """Result of a search for gains.

    - `aims`, `holds`, `confidence`, `seed`, `base`: the request.
    - `front`: the candidates that no other beats, with their aims on the cases of the search.
    - `gains`: of each of them, by path.
    - `before`: the aims of today's gains on the cases of the search.
    - `today`: the rows of today's gains on the held-out cases.
    - `held_out`: those of the front, one candidate after the other; None if there is none.
    - `table`: all rows but today's.
    """

    aims: tuple[str, ...]
    holds: tuple[str, ...]
    confidence: float
    seed: int
    base: ScenarioDescription
    front: Front
    gains: list[dict[str, Any]]
    before: np.ndarray
    today: Columns
    held_out: Columns | None
    table: Columns

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.table["row"]) + len(self.today["row"])

    @property
    def best(self) -> int | None:
        """The candidate whose worst aim, on the cases of the search, is best in proportion to today's."""
        if not len(self.gains):
            return None
        reference = np.where(np.isfinite(self.before), self.before, self.front.aims.min(axis=0))
        return int(np.argmin(np.max(self.front.aims / reference, axis=1)))

    @property
    def ended(self) -> str:
        """State of the rows."""
        if not len(self.gains):
            return f"none of {self.front.evaluations} candidates holds in all cases"
        return f"{self.front.holding} of {self.front.evaluations} candidates hold in all cases"

    def rows(self, place: int | None) -> Columns:
        """The rows on the held-out cases.

        - `place`: of a candidate on the front; None for today's gains.
        """
        if place is None or self.held_out is None:
            return self.today
        each = len(self.today["row"])
        return rows_of(self.held_out, place * each, (place + 1) * each)

    def judged(self, place: int | None) -> Candidate:
        """Return the score of gains on the held-out cases.

        - `place`: of a candidate on the front; None for today's gains.
        """
        rows = self.rows(place)
        held = np.ones(len(rows["row"]), bool)
        for text in self.holds:
            held &= Predicate(text).holds(rows)
        failures = int((~held).sum())
        failing = clopper_pearson(failures, held.size, self.confidence)
        return Candidate(
            {aim: float(rows[aim].mean()) for aim in self.aims},
            failures,
            held.size,
            Interval(1.0 - failing.upper, 1.0 - failing.lower, failing.confidence),
        )

    def difference(self, place: int, aim: str) -> PairedDifference:
        """By how much an aim of a candidate is above that of today's gains, case by case.

        - `place`: of the candidate on the front.
        - `aim`: key of a metric.
        """
        return paired_difference(self.rows(place)[aim], self.today[aim], self.confidence, seed=self.seed)

    @property
    def good(self) -> bool:
        """True if the best gains held in all held-out cases."""
        return self.best is not None and not self.judged(self.best).failures

    @property
    def lead(self) -> str:
        """The answer in a sentence."""
        if self.best is None:
            return f"No gains were found: {self.ended}."
        now, then = self.judged(self.best), self.judged(None)
        text = [f"{aim} {now.aims[aim] / then.aims[aim]:.3g} times" for aim in self.aims if then.aims[aim] > 0]
        failed = f"{now.failures} of {now.runs} held-out cases fail, with today's gains {then.failures}"
        return f"The best gains have {', '.join(text)} today's on held-out cases; {failed} ({self.ended})."

    @property
    def _names(self) -> list[str]:
        return [f"front-{place + 1}" for place in range(len(self.gains))]

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """The scenario with the best gains, and with those of the front."""
        built = [altered_description(self.base, gains) for gains in self.gains]
        best = {} if self.best is None else {"best": built[self.best]}
        return {**best, **dict(zip(self._names, built, strict=True))}

    def sections(self) -> list[Section]:
        """The front on held-out cases, its gains, and by how much the best differ from today's."""
        places: list[int | None] = [None, *range(len(self.gains))]
        judged = {place: self.judged(place) for place in places}
        names = {place: "today" if place is None else self._names[place] for place in places}
        rows: list[list[Cell]] = [
            [
                names[place] + (", best" if place is not None and place == self.best else ""),
                *item.aims.values(),
                item.failures,
                share(item.holding.lower),
            ]
            for place, item in judged.items()
        ]
        note = f"Means over {counted(judged[None].runs, 'case')} that the search has not seen; {self.ended}."
        head = ("Gains", *self.aims, "failed", "holds at least")
        figures = []
        if self.gains:
            front = np.array([list(judged[place].aims.values()) for place in range(len(self.gains))])
            today = np.array(list(judged[None].aims.values()))
            drawing = ([_label(aim) for aim in self.aims], front, today, self.best)
            figures = [Drawn("front", "The front", "Means over held-out cases.", "aims_front", drawing)]
        result = [Section("The front", note, head, rows, figures)]
        if self.best is None:
            return result
        paths = list(self.gains[0])
        values = [
            [names[place], *(_short(self.gains[place][path]) for path in paths)] for place in range(len(self.gains))
        ]
        result.append(Section("Its gains", "", ("Gains", *paths), values))
        differences = []
        for aim in self.aims:
            item = self.difference(self.best, aim)
            low, high = (item.of_mean.lower, item.of_mean.upper) if item.of_mean else (None, None)
            differences.append([aim, item.mean, low, high, item.p_value])
        note = f"Case by case on held-out cases, with {self.confidence:.0%} intervals; < 0 is better than today."
        head = ("Aim", "difference", "at least", "at most", "p, Wilcoxon")
        return [*result, Section("The best compared with today", note, head, differences)]

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        front = [self._place_as_json(place) for place in range(len(self.gains))]
        best = self.best
        shown = self.judged(best) if best is not None else None
        differences = {aim: self.difference(best, aim) for aim in self.aims} if best is not None else {}
        return {
            "kind": "tune",
            "runs": self.runs,
            "failures": None if shown is None else shown.failures,
            "probability": None if shown is None else interval_of(shown.holding),
            "ended": self.ended,
            "worst": NOTHING,
            "today": self._place_as_json(None),
            "front": front,
            "best": best,
            "difference": {
                aim: {"mean": item.mean, "interval": None if item.of_mean is None else interval_of(item.of_mean)}
                for aim, item in differences.items()
            },
        }

    def _place_as_json(self, place: int | None) -> dict[str, Any]:
        judged = self.judged(place)
        points = self.before if place is None else self.front.aims[place]
        return {
            "gains": None if place is None else self.gains[place],
            "search": {aim: float(value) for aim, value in zip(self.aims, points, strict=True)},
            "held_out": {**judged.aims, "failures": judged.failures, "runs": judged.runs},
            "holding": interval_of(judged.holding),
            "scenario": None if place is None else f"{self._names[place]}.yaml",
        }


def _label(aim: str) -> str:
    for item in METRICS:
        if item.key == aim:
            return f"{item.title}  [{item.unit.format(position='rad or m', torque='N m or N')}]"
    return aim


def _short(value: Any) -> str:
    numbers = np.atleast_1d(np.asarray(value, float)).ravel()
    return ", ".join(f"{number:.4g}" for number in numbers)
