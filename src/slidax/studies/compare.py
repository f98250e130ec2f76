"""Comparison of schemes or gains on the same cases."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from slidax.core.errors import count_noun, locate_errors, percent, plain_name
from slidax.scenarios.descriptions import input_field
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description
from slidax.scenarios.uncertainty import AbstractSet, Between, InsideEnvelope

from .cases import LARGER_IS_BETTER, Columns, points, require_metric
from .overview import share
from .predicates import ENVELOPE, Predicate
from .runner import PartDone
from .statistics import Interval, PairedDifference, PairedShares, clopper_pearson, paired_difference, paired_shares
from .study import AbstractResult, AbstractStudy, Cell, Chart, RunOptions, Section, all_done, interval_of, worst_row


@dataclass(frozen=True)
class CompareResult(AbstractResult):
    """Result of a comparison of schemes on the same cases. The first scheme is the reference.

    - `of`, `holds`, `confidence`, `seed`: as in `Compare`; `family` is that of the first scheme.
    - `tables`: table of each scheme, by its name, with a row for each case; a row number is the same case in all.
    """

    of: tuple[str, ...]
    holds: tuple[str, ...]
    confidence: float
    seed: int
    tables: dict[str, Columns]

    @property
    def runs(self) -> int:
        """Number of runs of all schemes."""
        return sum(len(table["row"]) for table in self.tables.values())

    @property
    def ended(self) -> str:
        """The sentence “all N runs are done”."""
        return all_done(self.runs)

    @property
    def reference(self) -> str:
        """Name of the scheme that the others are compared with."""
        return next(iter(self.tables))

    def difference(self, name: str, of: str) -> PairedDifference:
        """Return statistics of a metric's difference, scheme minus reference, over the cases that both completed.

        - `name`: name of the scheme.
        - `of`: key of the metric.
        """
        item, other = self.tables[name], self.tables[self.reference]
        complete = _reached_end(item) & _reached_end(other)
        return paired_difference(np.where(complete, item[of], np.nan), other[of], self.confidence, seed=self.seed)

    def shares(self, name: str, holds: str) -> PairedShares | None:
        """Compare the share of cases that have a property: return the difference, scheme minus reference.

        The result is None if the property is `envelope` and one of the two schemes has no envelope.

        - `name`: name of the scheme.
        - `holds`: the property, such as `envelope` or `steady_error < 1e-3`.
        """
        if not all(is_defined(holds, self.tables[each]) for each in (name, self.reference)):
            return None
        predicate = Predicate(holds)
        item, other = (predicate.holds(self.tables[each]) for each in (name, self.reference))
        return paired_shares(item, other, self.confidence)

    def rate(self, name: str, holds: str) -> tuple[int | None, Interval | None]:
        """Return the number of cases without a property, and a confidence interval for the property's probability.

        Both are None if the property is `envelope` and the scheme has no envelope.

        - `name`: name of the scheme.
        - `holds`: the property, as in `shares`.
        """
        if not is_defined(holds, self.tables[name]):
            return None, None
        failures = int(np.sum(~Predicate(holds).holds(self.tables[name])))
        failing = clopper_pearson(failures, len(self.tables[name]["row"]), self.confidence)
        return failures, Interval(1.0 - failing.upper, 1.0 - failing.lower, failing.confidence)

    @property
    def good(self) -> bool:
        """True if no run of any scheme failed."""
        return not any(np.any(table["outcome"] > 0) for table in self.tables.values())

    @property
    def summary(self) -> str:
        text = []
        for name in list(self.tables)[1:]:
            signs = {of: -1.0 if of in LARGER_IS_BETTER else 1.0 for of in self.of}
            better = [of for of in self.of if _is_below(self.difference(name, of), signs[of])]
            worse = [of for of in self.of if _is_below(self.difference(name, of), -signs[of])]
            words = [f"{word} in {', '.join(ofs)}" for word, ofs in (("better", better), ("worse", worse)) if ofs]
            text.append(f"{name} is {' and '.join(words) or 'not significantly different'}")
        cases = count_noun(len(self._cases), "case")
        return f"{cases} for each scheme; compared with {self.reference}, {'; '.join(text)}."

    @property
    def _cases(self) -> np.ndarray:
        return self.tables[self.reference]["row"]

    def sections(self) -> list[Section]:
        """Return the sections on shares of cases, means, and differences with their intervals."""
        rates: list[list[Cell]] = []
        for name in self.tables:
            for holds in self.holds:
                failures, holding = self.rate(name, holds)
                bounds = (None, None) if holding is None else (share(holding.lower), share(holding.upper))
                both = None if name == self.reference else self.shares(name, holds)
                rates.append([name, holds, failures, *bounds, None if both is None else both.p_value])
        note = (
            f"Of {count_noun(len(self._cases), 'case')}; intervals at {percent(self.confidence)}; p by McNemar's "
            "exact test."
        )
        head = ("Scheme", "Requirement", "Failed", "Holds at least", "Holds at most", "p, against the first")
        result = [Section("Rates", note, head, rates)]
        others = list(self.tables)[1:]
        rows: list[list[Cell]] = []
        drawn = {}
        for of in self.of:
            ends = []
            for name in others:
                item = self.difference(name, of)
                low, high = (item.of_mean.lower, item.of_mean.upper) if item.of_mean else (None, None)
                rows.append(
                    [name, of, item.pairs, self._mean(name, of), item.mean, low, high, item.median, item.p_value]
                )
                ends.append([np.nan if x is None else x for x in (low, item.mean, high)])
            drawn[of.replace("_", " ")] = np.array(ends)
        pictures = [
            Chart("differences", "Differences", "Difference of means, with intervals.", "intervals", (others, drawn)),
        ]
        columns = ("Scheme", "Metric", "Pairs", "Mean", "Difference", "At least", "At most", "Median", "p, Wilcoxon")
        first = ", ".join(f"{of} {_shown(self._mean(self.reference, of))}" for of in self.of)
        larger = ", ".join(f"`{of}`" for of in self.of if of in LARGER_IS_BETTER)
        rule = f"< 0 is better, but for {larger} > 0" if larger else "< 0 is better"
        note = f"Difference from {self.reference}, case by case; {rule}. The means of the reference are {first}."
        return [*result, Section("Differences", note, columns, rows, pictures)]

    def _mean(self, name: str, of: str) -> float | None:
        numbers = self.tables[name][of][_reached_end(self.tables[name])]
        known = numbers[np.isfinite(numbers)]
        return float(known.mean()) if known.size else None

    def as_json(self) -> dict[str, Any]:
        failures, holding = self.rate(self.reference, self.holds[0])
        return {
            "kind": "compare",
            "runs": self.runs,
            "failures": failures,
            "probability": interval_of(holding),
            "ended": self.ended,
            "worst": worst_row(self.tables[self.reference]),
            "reference": self.reference,
            "schemes": {name: self._scheme_as_json(name) for name in self.tables},
        }

    def _scheme_as_json(self, name: str) -> dict[str, Any]:
        table = self.tables[name]
        complete = _reached_end(table)
        result: dict[str, Any] = {
            "ended_early": int(np.sum(~complete)),
            "means": {of: self._mean(name, of) for of in self.of},
            "holds": {},
        }
        for holds in self.holds:
            failures, holding = self.rate(name, holds)
            result["holds"][holds] = {"failures": failures, "probability": interval_of(holding)}
        if name != self.reference:
            result["differences"] = {of: self._difference_as_json(name, of) for of in self.of}
            for holds in self.holds:
                shares = self.shares(name, holds)
                if shares is not None:
                    result["holds"][holds] |= {
                        "difference": shares.difference,
                        "interval": interval_of(shares.interval),
                        "p_value": shares.p_value,
                    }
        return result

    def _difference_as_json(self, name: str, of: str) -> dict[str, Any]:
        item = self.difference(name, of)
        return {
            "pairs": item.pairs,
            "mean": item.mean,
            "interval": interval_of(item.of_mean),
            "median": item.median,
            "median_interval": interval_of(item.of_median),
            "p_value": item.p_value,
        }


def is_defined(holds: str, table: Columns) -> bool:
    """True if a property is defined for the runs of a scheme; `envelope` needs a scheme with an envelope.

    - `holds`: the property, such as `envelope` or `steady_error < 1e-3`.
    - `table`: rows of the scheme.
    """
    return holds != ENVELOPE or bool(np.isfinite(table["margin"]).any())


def _reached_end(table: Columns) -> np.ndarray:
    """True for runs that reached their end, inside the envelope or not."""
    return np.asarray((table["outcome"] == 0) | (table["outcome"] == 3))


def _is_below(item: PairedDifference, sign: float) -> bool:
    """True if the interval of the mean difference is below 0; with sign -1, if it is above 0."""
    if item.of_mean is None:
        return False
    return max(sign * item.of_mean.lower, sign * item.of_mean.upper) < 0.0


def _shown(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"


OF = ("steady_error", "max_torque_step", "peak_torque")


class Compare(AbstractStudy):
    """Runs several schemes on the same cases and compares them with the first."""

    in_parts: ClassVar[bool] = True
    study: Literal["compare"]
    schemes: Annotated[dict[str, dict[str, Any]], Field(min_length=2, max_length=50)]
    """By name of each scheme, the scenario's changed values by path, as with `--set`; `{}` for no change."""
    runs: int = input_field("cases for each scheme", "", "[1, 1e9]", default=500)
    of: Annotated[tuple[str, ...], Field(min_length=1)] = OF
    """Metrics to compare."""
    holds: Annotated[tuple[str, ...], Field(min_length=1)] = (ENVELOPE,)
    """Properties whose shares are compared: `envelope`, or a condition such as `steady_error < 1e-3`."""
    confidence: float = input_field("confidence of the intervals", "", "(0, 1)", default=0.95)

    @field_validator("schemes")
    @classmethod
    def _names_are_names_of_folders(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name in value:
            if not name or not name.replace("-", "").replace("_", "").replace(".", "").isalnum() or name[0] == ".":
                raise ValueError(f"`{plain_name(name)}` must be letters, digits, `-`, `_` and `.`, with no `.` first")
        return value

    def run(self, how: RunOptions) -> CompareResult:
        holds = [Predicate(text) for text in self.holds]
        families = self._families()
        first = next(iter(families.values()))
        self.require(
            bool(first.space.sets), "uncertainty", "is empty: all cases would be equal; give sets of uncertain values"
        )
        cases = first.space.values(points(self.seed, 0, self.runs, first.space.dimensions))
        how.begin(self.runs * len(families))
        tables: dict[str, Columns] = {}
        computed, seconds, missing = 0, 0.0, 0
        for name, family in families.items():
            own = how if how.out is None else replace(how, out=Path(how.out, name))
            runner = self.runner(family, own)
            try:
                tables[name] = runner.rows(0, cases)
            except PartDone as part:
                missing += part.missing
                continue
            computed, seconds = computed + runner.computed, seconds + runner.seconds
            if runner.store is not None:
                runner.store.finish(self.runs)
        if missing:
            raise PartDone(missing, self.runs * len(families))
        for item in self.of:
            require_metric(item, tables[next(iter(tables))], "of")
        for predicate in holds:
            for table in tables.values():
                if is_defined(predicate.text, table):
                    predicate.holds(table)
        return CompareResult(
            of=self.of,
            holds=self.holds,
            confidence=self.confidence,
            seed=self.seed,
            family=first,
            tables=tables,
            path=how.out,
            computed=computed,
            seconds=seconds,
        )

    def _families(self) -> dict[str, Family]:
        """Return a family per scheme, with the same sets; `inside envelope` refers to the first scheme's envelope."""
        base = self.described()
        sets = self.sets(base)
        result: dict[str, Family] = {}
        for name, changes in self.schemes.items():
            with locate_errors(f"schemes.{name}"):
                own = alter_description(base, changes) if changes else base
                result[name] = Family.of(own, sets)
            if len(result) == 1:
                sets = dict(_box(path, item, result[name]) for path, item in sets.items())
        return result


def _box(path: str, item: AbstractSet, family: Family) -> tuple[str, AbstractSet]:
    """Replace a set that depends on the scheme's envelope by its numerical bounds."""
    if not isinstance(item, InsideEnvelope):
        return path, item
    path = path if path in family.space.leaves else "start.q"
    leaf = family.space.leaves[path]
    ends = [item.values(np.full((1, item.coordinates(leaf)), u), leaf)[0].tolist() for u in (0.0, 1.0)]
    return path, Between(between=ends, each=item.each)
