"""The gains that are best for all that may be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax.reports import write_scenario
from slidax.scenarios.base import said
from slidax.scenarios.family import Family
from slidax.scenarios.load import altered_description
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.scenarios.uncertainty.space import as_changes

from .asked import BELOW_ONE, Asked
from .cases import Values
from .gains import OnCases, judged, point_of_own
from .points import points
from .predicate import ENVELOPE, Predicate
from .search import Front, Judged, several_aims
from .statistics import Interval, PairedDifference, clopper_pearson, paired_difference
from .study import AbstractStudy, How
from .table import Columns

AIMS = ("steady_error", "steady_torque_step", "peak_torque")


class Tune(AbstractStudy):
    """Searches for gains on some cases of what is uncertain, and judges the best of them on others.

    Every candidate is run on the same cases. Those for which something does not hold in one of them are out; of the
    others the front is kept: candidates that no other beats in all aims. The aims of today's gains, and of the front,
    are then measured on cases that the search has not seen.
    """

    study: Literal["tune"]
    gains: Annotated[Uncertainty, Field(min_length=1)]
    """Sets by path of what may be chosen, such as `scheme.surface.k1: {between: [0.1, 2]}`."""
    aims: Annotated[tuple[str, ...], Field(min_length=1)] = AIMS
    """Metrics that are to be small, in the mean over the cases."""
    holds: tuple[str, ...] = (ENVELOPE,)
    """What must hold in every case: `envelope`, or a metric, a sign and a number."""
    margin: float = said(
        "the least margin that every case must have, so that others hold, too", "", "[0, 1)", default=0.0
    )
    cases: Annotated[int, Field(ge=1, le=100_000)] = 16
    """On how many each candidate is judged; one if nothing is uncertain."""
    candidates: Annotated[int, Field(ge=1, le=10_000_000)] = 600
    """How many at most."""
    seconds: float | None = said(
        "after so many no batch begins; the rows then depend on the machine", "s", "> 0", default=None
    )
    held_out: Annotated[int, Field(ge=1, le=10_000_000)] = 200
    """Cases that the front is judged on afterwards."""
    keep: Annotated[int, Field(ge=1, le=1000)] = 12
    """How many candidates of the front are kept, spread along it."""
    confidence: float = said("of the intervals", "", "(0, 1)", default=0.95)

    def run(self, how: How) -> TuneResult:
        """The front.

        - `how`: where, and what is told on the way.
        """
        holds = [Predicate(text) for text in self.holds]
        family = self.family(self.gains)
        seen, unseen = self._cases(family)
        runner = self.runner(family, how)
        asked = Asked(runner, family.space)
        on = OnCases(asked, family.varied, seen, self.aims, holds, self.margin)
        how.begin((self.candidates + 1) * on.each + (self.keep + 1) * self._each(unseen))
        today = self._today(how, seen, unseen)
        before = judged(_rows(today, 0, on.each), on.each, self.aims, holds, self.margin)
        front = several_aims(
            on.judge,
            family.varied.dimensions,
            evaluations=self.candidates,
            start=point_of_own(family.varied),
            seed=self.seed,
            seconds=self.seconds,
            most=self.keep,
        )
        table = on.rows(front.points, unseen) if len(front.points) else None
        chosen = self._chosen(family, front)
        files = self._written(chosen, how.out)
        found = TuneResult(
            study=self,
            family=family,
            front=front,
            gains=chosen,
            before=before,
            today=_rows(today, on.each, None),
            held_out=table,
            table=asked.table,
            files=files,
            path=asked.finish(),
            computed=runner.computed,
            seconds=runner.seconds,
        )
        if how.out is not None and found.best is not None:
            write_scenario(self._description(chosen[found.best]), how.out / "best.yaml")
        return found

    def _cases(self, family: Family) -> tuple[Values, Values]:
        """Those that candidates are judged on, and others."""
        space = family.uncertain
        if not space.sets:
            return {}, {}
        drawn = space.values(points(self.seed, 0, self.cases + self.held_out, space.dimensions))
        return (
            {path: array[: self.cases] for path, array in drawn.items()},
            {path: array[self.cases :] for path, array in drawn.items()},
        )

    @staticmethod
    def _each(cases: Values) -> int:
        return len(next(iter(cases.values()))) if cases else 1

    def _today(self, how: How, seen: Values, unseen: Values) -> Columns:
        """The scenario as it is, on all cases."""
        family = self.family()
        runner = self.runner(family, replace(how, out=None if how.out is None else how.out / "today"))
        both = {path: np.concatenate([seen[path], unseen[path]]) for path in seen}
        # Without anything uncertain one run is both.
        columns = runner.rows(0, both) if both else runner.rows(0, {})
        if runner.store is not None:
            runner.store.finish(len(columns["row"]))
        return columns if both else {name: np.concatenate([array, array]) for name, array in columns.items()}

    def _chosen(self, family: Family, front: Front) -> list[dict[str, Any]]:
        values = family.varied.values(np.clip(front.points, 0.0, BELOW_ONE)) if len(front.points) else {}
        return [as_changes({path: array[k] for path, array in values.items()}) for k in range(len(front.points))]

    def _description(self, gains: dict[str, Any]) -> Any:
        return altered_description(self.described(), gains)

    def _written(self, chosen: list[dict[str, Any]], out: Path | None) -> tuple[Path, ...]:
        if out is None:
            return ()
        paths = tuple(out / f"front-{number}.yaml" for number in range(1, len(chosen) + 1))
        for path, gains in zip(paths, chosen, strict=True):
            write_scenario(self._description(gains), path)
        return paths


def _rows(columns: Columns, first: int, last: int | None) -> Columns:
    return {name: array[first:last] for name, array in columns.items()}


@dataclass(frozen=True)
class Candidate:
    """What some gains are worth on cases that the search has not seen.

    - `aims`: the mean of each metric, by its key.
    - `failures`, `runs`: in how many of the cases something did not hold.
    - `holding`: interval of the probability that all holds.
    """

    aims: dict[str, float]
    failures: int
    runs: int
    holding: Interval


@dataclass(frozen=True)
class TuneResult:
    """What a search for gains found.

    - `study`, `family`: what was asked.
    - `front`: the candidates that no other beats, with their aims on the cases of the search.
    - `gains`: of each of them, by path.
    - `before`: today's gains on the cases of the search.
    - `today`: the rows of today's gains on the held-out cases.
    - `held_out`: those of the front, one candidate after the other; None if there is none.
    - `table`: all rows but today's.
    - `files`: the scenarios of the front; none if the rows are not kept.
    - `path`: of the table; None if it was not kept.
    - `computed`, `seconds`: rows that were not stored before, and the time that they took.
    """

    study: Tune
    family: Family
    front: Front
    gains: list[dict[str, Any]]
    before: Judged
    today: Columns
    held_out: Columns | None
    table: Columns
    files: tuple[Path, ...]
    path: Any
    computed: int
    seconds: float

    @property
    def runs(self) -> int:
        """How many there were."""
        return len(self.table["row"]) + len(self.today["row"])

    @property
    def best(self) -> int | None:
        """The candidate whose worst aim, on the cases of the search, is best in proportion to today's."""
        if not len(self.gains):
            return None
        reference = np.where(np.isfinite(self.before.aims[0]), self.before.aims[0], self.front.aims.min(axis=0))
        return int(np.argmin(np.max(self.front.aims / reference, axis=1)))

    @property
    def ended(self) -> str:
        """What there is."""
        if not len(self.gains):
            return f"none of {self.front.evaluations} candidates holds in all cases"
        return f"{self.front.holding} of {self.front.evaluations} candidates hold in all cases"

    def rows_of(self, place: int | None) -> Columns:
        """The rows on the held-out cases.

        - `place`: of a candidate on the front; None for today's gains.
        """
        if place is None or self.held_out is None:
            return self.today
        each = len(self.today["row"])
        return _rows(self.held_out, place * each, (place + 1) * each)

    def judged(self, place: int | None) -> Candidate:
        """What gains are worth on the held-out cases.

        - `place`: of a candidate on the front; None for today's gains.
        """
        rows = self.rows_of(place)
        held = np.ones(len(rows["row"]), bool)
        for text in self.study.holds:
            held &= Predicate(text).holds(rows)
        failures = int((~held).sum())
        failing = clopper_pearson(failures, held.size, self.study.confidence)
        return Candidate(
            {aim: float(rows[aim].mean()) for aim in self.study.aims},
            failures,
            held.size,
            Interval(1.0 - failing.upper, 1.0 - failing.lower, failing.confidence),
        )

    def difference(self, place: int, aim: str) -> PairedDifference:
        """By how much an aim of a candidate is above that of today's gains, case by case.

        - `place`: of the candidate on the front.
        - `aim`: key of a metric.
        """
        return paired_difference(self.rows_of(place)[aim], self.today[aim], self.study.confidence, seed=self.study.seed)

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        front = [self._said(place) for place in range(len(self.gains))]
        best = self.best
        shown = self.judged(best) if best is not None else None
        differences = {aim: self.difference(best, aim) for aim in self.study.aims} if best is not None else {}
        return {
            "kind": "tune",
            "runs": self.runs,
            "failures": None if shown is None else shown.failures,
            "probability": None if shown is None else _interval(shown.holding),
            "ended": self.ended,
            "worst": None,
            "today": self._said(None),
            "front": front,
            "best": best,
            "difference": {
                aim: {"mean": one.mean, "interval": None if one.of_mean is None else _interval(one.of_mean)}
                for aim, one in differences.items()
            },
        }

    def _said(self, place: int | None) -> dict[str, Any]:
        judged = self.judged(place)
        seen = self.before.aims[0] if place is None else self.front.aims[place]
        return {
            "gains": None if place is None else self.gains[place],
            "search": {aim: float(value) for aim, value in zip(self.study.aims, seen, strict=True)},
            "held_out": {**judged.aims, "failures": judged.failures, "runs": judged.runs},
            "holding": _interval(judged.holding),
            "scenario": None if place is None or not self.files else str(self.files[place]),
        }


def _interval(one: Interval) -> dict[str, float]:
    return {"lower": one.lower, "upper": one.upper, "confidence": one.confidence}
