"""Monte Carlo studies: the probability that a scenario keeps its envelope."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from slidax.core.errors import count_noun
from slidax.scenarios.descriptions import input_field
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import ScenarioDescription

from .cases import OUTCOMES, Columns, Values, concatenate, points
from .overview import failure_reason, overview, share
from .predicates import ENVELOPE, Predicate, SequentialStop, UntilDescription
from .statistics import Interval, clopper_pearson, confidence_sequence
from .study import AbstractStudy, AbstractTableResult, RunOptions, Section


class MonteCarlo(AbstractStudy):
    """Runs random cases from their distributions, and counts how often properties hold."""

    in_parts: ClassVar[bool] = True
    study: Literal["monte_carlo"]
    runs: int = input_field("number of runs; the largest number with `until`", "", "[1, 1e9]")
    holds: tuple[str, ...] = (ENVELOPE,)
    """Counted properties: `envelope`, or a condition such as `steady_error < 1e-3`. `until` refers to the first."""
    confidence: float = input_field("confidence of the intervals", "", "(0, 1)", default=0.99)
    until: UntilDescription | None = None
    """Rule to stop early: once an anytime-valid interval shows the first property, or once it failed too often."""

    def run(self, how: RunOptions) -> MonteCarloResult:
        predicates = [Predicate(text) for text in self.holds]
        self.require(bool(predicates), "holds", "must have an entry, such as `envelope`")
        family = self.family()
        self.require(
            bool(family.space.sets),
            "uncertainty",
            "is empty: all runs would be the same; give sets of uncertain values, such as "
            "`robot.plant.load.mass: {between: [0, 3]}`",
        )
        runner = self.runner(family, how)
        how.begin(self.runs)
        parts: dict[int, Columns] = {}
        stop = SequentialStop(self.until, self.confidence)
        for first, columns in runner.stream(self._chunks(family, runner.chunk)):
            parts[first] = columns
            if stop.enough(parts, predicates[0]):
                break
        table = concatenate(parts)
        if self.until is not None:
            table = {name: values[: stop.runs] for name, values in table.items()}
        path = None if runner.store is None else runner.store.finish(stop.stored(parts))
        rates = tuple(self._rate(item, table) for item in predicates)
        result = MonteCarloResult(
            study=self,
            family=family,
            table=table,
            path=path,
            computed=runner.computed,
            seconds=runner.seconds,
            rates=rates,
            ended=stop.ended(self.runs),
        )
        every = rates[0].failures == rates[0].runs
        return replace(result, why=failure_reason(family, result.case(result.worst))) if every else result

    def values(self, family: Family, first: int, rows: int) -> Values:
        """Return the uncertain values drawn for consecutive rows.

        The result has an array for each dotted path of the scenario, whose first axis is the row.

        - `family`: the family of scenarios.
        - `first`: number of the first row.
        - `rows`: number of rows.
        """
        return family.space.values(points(self.seed, first, rows, family.space.dimensions))

    def _chunks(self, family: Family, chunk: int) -> Iterator[tuple[int, Values]]:
        for first in range(0, self.runs, chunk):
            yield first, self.values(family, first, min(chunk, self.runs - first))

    def _rate(self, predicate: Predicate, table: Columns) -> Rate:
        held = predicate.holds(table)
        failures, runs = int((~held).sum()), len(held)
        if self.until is None:
            return Rate(predicate.text, runs, failures, clopper_pearson(failures, runs, self.confidence), False)
        return Rate(predicate.text, runs, failures, confidence_sequence(failures, runs, self.confidence), True)


@dataclass(frozen=True)
class Rate:
    """Failure rate of a property over the runs of a study.

    - `holds`: the property, such as `envelope` or `steady_error < 1e-3`.
    - `runs`, `failures`: number of runs and of failures.
    - `failing`: confidence interval of the failure rate.
    - `anytime`: True for a confidence sequence, which is valid at any stopping time; False for Clopper and Pearson's.
    """

    holds: str
    runs: int
    failures: int
    failing: Interval
    anytime: bool

    @property
    def holding(self) -> Interval:
        """Confidence interval of the probability that the property holds."""
        item = self.failing
        return Interval(1.0 - item.upper, 1.0 - item.lower, item.confidence)


@dataclass(frozen=True)
class MonteCarloResult(AbstractTableResult):
    """Result of a Monte Carlo study.

    - `rates`: failure rate of each property.
    - `ended`: reason for the end of the study, in words.
    - `why`: likeliest cause in the worst run, if every run failed.
    """

    study: MonteCarlo
    rates: tuple[Rate, ...]
    ended: str
    why: str = ""

    @property
    def runs(self) -> int:
        return self.rates[0].runs

    @property
    def worst(self) -> int:
        """The row with the least margin; without an envelope, the row with the largest steady error."""
        margin = self.table["margin"]
        if np.isnan(margin).all():
            return int(np.nanargmax(self.table["steady_error"]))
        return int(np.nanargmin(margin))

    @property
    def good(self) -> bool:
        """True if the first property held in every run."""
        return not self.rates[0].failures

    @property
    def summary(self) -> str:
        first, holding = self.rates[0], self.rates[0].holding
        property_holds = "the envelope holds" if first.holds == ENVELOPE else f"`{first.holds}` holds"
        failed = "none failed" if not first.failures else f"{first.failures} failed"
        return (
            f"{count_noun(first.runs, 'run')}, {failed}: with {100 * holding.confidence:g} % confidence "
            f"{property_holds} with a "
            f"probability between {share(holding.lower)} and {share(holding.upper)} ({self.ended})."
        )

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """Return the scenario of the worst case under the name `worst`."""
        return {"worst": self.family.case(self.case(self.worst))}

    def case(self, row: int) -> dict[str, Any]:
        """Return the uncertain values of a row, by dotted path.

        - `row`: number of the row.
        """
        return {path: array[0] for path, array in self.study.values(self.family, row, 1).items()}

    def sections(self) -> list[Section]:
        """Return the sections on rates, failures, metrics, and the worst case."""
        rates = [
            (item.holds, item.runs, item.failures, share(item.holding.lower), share(item.holding.upper))
            for item in self.rates
        ]
        interval = "Confidence sequences, valid at any stopping time" if self.rates[0].anytime else "Exact intervals"
        result = [
            Section(
                "Rates",
                f"{interval}, at {100 * self.study.confidence:g} % confidence.",
                ("Requirement", "Runs", "Failed", "Holds at least", "Holds at most"),
                rates,
            )
        ]
        if self.causes:
            names = self.family.joint_names
            rows = [(kind.replace("_", " "), names[joint - 1], count) for kind, joint, count in self.causes]
            note = f"Every run failed. Most likely cause: {self.why}" if self.why else "By outcome and joint."
            result.append(Section("Failures", note, ("Outcome", "Joint", "Runs"), rows))
        return [*result, *overview(self.family, self.table, self.case(self.worst), self.worst)]

    @property
    def causes(self) -> list[tuple[str, int, int]]:
        """Failed runs by outcome and joint: tuples of outcome, joint from 1, and number of runs; see `causes_of`."""
        return causes_of(self.table)

    def as_json(self) -> dict[str, Any]:
        first = self.rates[0]
        margin = float(self.table["margin"][self.worst])
        return {
            "kind": "monte_carlo",
            "runs": first.runs,
            "failures": first.failures,
            "probability": {
                "lower": first.holding.lower,
                "upper": first.holding.upper,
                "confidence": first.holding.confidence,
                "anytime": first.anytime,
            },
            "ended": self.ended,
            "holds": [
                {
                    "holds": item.holds,
                    "failures": item.failures,
                    "lower": item.holding.lower,
                    "upper": item.holding.upper,
                }
                for item in self.rates
            ],
            "causes": [{"outcome": kind, "joint": joint, "runs": count} for kind, joint, count in self.causes],
            **({"why": self.why} if self.why else {}),
            "worst": {"row": self.worst, "margin": margin if np.isfinite(margin) else None},
        }


def causes_of(table: Columns) -> list[tuple[str, int, int]]:
    """Count the failed runs by outcome and joint.

    Returns tuples of outcome, joint (from 1) and number of runs, the most common first.

    - `table`: outcome and metrics of the runs.
    """
    bad = table["outcome"] > 0
    kinds, counts = np.unique(
        np.stack([table["outcome"][bad], table["joint"][bad]], axis=1).astype(int), axis=0, return_counts=True
    )
    result = [(OUTCOMES[kind], int(joint), int(n)) for (kind, joint), n in zip(kinds.tolist(), counts, strict=True)]
    return sorted(result, key=lambda item: -item[2])
