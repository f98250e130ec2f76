"""Schemes, or gains, on the same cases."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from slidax._errors import DefinitionError, located, nearest, plain
from slidax.scenarios.base import said
from slidax.scenarios.family import Family
from slidax.scenarios.load import altered_description

from .cases import Values
from .points import points
from .predicate import ENVELOPE, Predicate
from .statistics import Interval, PairedDifference, PairedShares, clopper_pearson, paired_difference, paired_shares
from .study import AbstractStudy, How
from .table import Columns

OF = ("steady_error", "max_torque_step", "peak_torque")


class Compare(AbstractStudy):
    """Runs several schemes on the same cases; the first is the one that the others are compared with."""

    study: Literal["compare"]
    schemes: Annotated[dict[str, dict[str, Any]], Field(min_length=2, max_length=50)]
    """Values of the scenario by path, as `--set` has them, by a name for each; `{}` is the scenario as it is."""
    runs: int = said("cases for each scheme", "", "[1, 1e9]", default=500)
    of: Annotated[tuple[str, ...], Field(min_length=1)] = OF
    """Metrics that are compared."""
    holds: tuple[str, ...] = (ENVELOPE,)
    """Properties whose shares are compared: `envelope`, or a metric, a sign and a number."""
    confidence: float = said("of the intervals", "", "(0, 1)", default=0.95)

    @field_validator("schemes")
    @classmethod
    def _names_are_names_of_folders(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name in value:
            if not name or not name.replace("-", "").replace("_", "").replace(".", "").isalnum() or name[0] == ".":
                raise ValueError(f"`{plain(name)}` must be letters, digits, `-`, `_` and `.`")
        return value

    def run(self, how: How) -> CompareResult:
        """The differences.

        - `how`: where, and what is told on the way.
        """
        holds = [Predicate(text) for text in self.holds]
        families = {name: self._family(name, changes) for name, changes in self.schemes.items()}
        first = next(iter(families.values()))
        self.require(bool(first.space.sets), "uncertainty", "is empty, so that all cases would be the same")
        how.begin(self.runs * len(families))
        tables: dict[str, Columns] = {}
        computed, seconds = 0, 0.0
        for name, family in families.items():
            own = how if how.out is None else replace(how, out=how.out / name)
            runner = self.runner(family, own)
            tables[name] = runner.rows(0, self._cases(family))
            computed, seconds = computed + runner.computed, seconds + runner.seconds
            if runner.store is not None:
                runner.store.finish(self.runs)
        for one in self.of:
            if one not in tables[next(iter(tables))]:
                raise DefinitionError(
                    f"there is no metric `{plain(one)}`; {nearest(one, tables[next(iter(tables))])}", where="of"
                )
        for predicate in holds:
            for table in tables.values():
                predicate.holds(table)
        return CompareResult(self, first, tables, how.out, computed, seconds)

    def _family(self, name: str, changes: dict[str, Any]) -> Family:
        with located(f"schemes.{name}"):
            base = altered_description(self.described(), changes) if changes else self.described()
        return Family.of(base, self.sets(base))

    def _cases(self, family: Family) -> Values:
        return family.space.values(points(self.seed, 0, self.runs, family.space.dimensions))


@dataclass(frozen=True)
class CompareResult:
    """Schemes on the same cases.

    - `study`: what was asked.
    - `family`: that of the first scheme.
    - `tables`: the rows of each scheme, by its name; the same row is the same case.
    - `path`: the folder that has a table for each; None if they were not kept.
    - `computed`, `seconds`: rows that were not stored before, and the time that they took.
    """

    study: Compare
    family: Family
    tables: dict[str, Columns]
    path: Any
    computed: int
    seconds: float

    @property
    def runs(self) -> int:
        """How many there were, of all schemes."""
        return sum(len(table["row"]) for table in self.tables.values())

    @property
    def ended(self) -> str:
        """What there is."""
        return f"all {self.runs} runs are done"

    @property
    def reference(self) -> str:
        """The scheme that the others are compared with."""
        return next(iter(self.tables))

    def difference(self, name: str, of: str) -> PairedDifference:
        """By how much a metric is above that of the reference, over the cases that both ran to the end.

        - `name`: of the scheme.
        - `of`: key of the metric.
        """
        one, other = self.tables[name], self.tables[self.reference]
        whole = _to_the_end(one) & _to_the_end(other)
        return paired_difference(
            np.where(whole, one[of], np.nan), other[of], self.study.confidence, seed=self.study.seed
        )

    def shares(self, name: str, holds: str) -> PairedShares:
        """In what share of the cases something holds, less the share in which it does for the reference.

        - `name`: of the scheme.
        - `holds`: what holds.
        """
        predicate = Predicate(holds)
        one, other = (predicate.holds(self.tables[each]) for each in (name, self.reference))
        return paired_shares(one, other, self.study.confidence)

    def rate(self, name: str, holds: str) -> tuple[int, Interval]:
        """In how many cases something fails, and an interval of the probability that it holds.

        - `name`: of the scheme.
        - `holds`: what.
        """
        failures = int(np.sum(~Predicate(holds).holds(self.tables[name])))
        failing = clopper_pearson(failures, len(self.tables[name]["row"]), self.study.confidence)
        return failures, Interval(1.0 - failing.upper, 1.0 - failing.lower, failing.confidence)

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        table = self.tables[self.reference]
        failures, holding = self.rate(self.reference, self.study.holds[0]) if self.study.holds else (None, None)
        known = np.isfinite(table["margin"])
        row = int(np.nanargmin(table["margin"])) if known.any() else None
        return {
            "kind": "compare",
            "runs": self.runs,
            "failures": failures,
            "probability": _interval(holding),
            "ended": self.ended,
            "worst": None if row is None else {"row": row, "margin": float(table["margin"][row]), "scenario": None},
            "reference": self.reference,
            "schemes": {name: self._said(name) for name in self.tables},
        }

    def _said(self, name: str) -> dict[str, Any]:
        table = self.tables[name]
        whole = _to_the_end(table)
        found: dict[str, Any] = {
            "ended_early": int(np.sum(~whole)),
            "means": {of: float(table[of][whole].mean()) if whole.any() else None for of in self.study.of},
            "holds": {},
        }
        for holds in self.study.holds:
            failures, holding = self.rate(name, holds)
            found["holds"][holds] = {"failures": failures, "probability": _interval(holding)}
        if name != self.reference:
            found["differences"] = {of: self._compared(name, of) for of in self.study.of}
            for holds in self.study.holds:
                shares = self.shares(name, holds)
                found["holds"][holds] |= {
                    "difference": shares.difference,
                    "interval": _interval(shares.interval),
                    "p_value": shares.p_value,
                }
        return found

    def _compared(self, name: str, of: str) -> dict[str, Any]:
        one = self.difference(name, of)
        return {
            "pairs": one.pairs,
            "mean": one.mean,
            "interval": _interval(one.of_mean),
            "median": one.median,
            "median_interval": _interval(one.of_median),
            "p_value": one.p_value,
        }


def _to_the_end(table: Columns) -> np.ndarray:
    """Runs that reached their end, inside the envelope or not."""
    return np.asarray((table["outcome"] == 0) | (table["outcome"] == 3))


def _interval(one: Interval | None) -> dict[str, float] | None:
    return None if one is None else {"lower": one.lower, "upper": one.upper, "confidence": one.confidence}
