"""Tuning: gains for several objectives, searched on training cases and scored on held-out cases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax.analysis.metrics import METRICS
from slidax.core.errors import DefinitionError, count_noun, percent
from slidax.scenarios.descriptions import input_field
from slidax.scenarios.family import Family, Space, as_changes
from slidax.scenarios.load import alter_description
from slidax.scenarios.scenario import ScenarioDescription
from slidax.scenarios.uncertainty import Uncertainty

from .cases import COUNTS, LARGER_IS_BETTER, Columns, Values, points, require_metric
from .overview import share
from .pareto import Front, FrontEvaluation, pareto_search
from .predicates import ENVELOPE, Predicate
from .runner import BELOW_ONE, BatchEvaluator
from .statistics import Interval, PairedDifference, clopper_pearson, paired_difference
from .study import NO_WORST_CASE, AbstractResult, AbstractStudy, Cell, Chart, RunOptions, Section, interval_of


class CaseEvaluator:
    """Evaluates candidate gains, as points of the unit cube, all on the same cases.

    - `evaluator`: simulates the rows.
    - `gains`: sets of the gains, which map points to gains.
    - `cases`: uncertain values of the cases: an array for each path, whose first axis is the case.
    - `aims`: keys of the metrics whose means over the cases are minimised.
    - `holds`: properties that must hold in every case.
    - `margin`: least envelope margin required in every case.
    """

    def __init__(
        self,
        evaluator: BatchEvaluator,
        gains: Space,
        cases: Values,
        aims: Sequence[str],
        holds: Sequence[Predicate],
        margin: float,
    ) -> None:
        self.evaluator = evaluator
        self.gains = gains
        self.cases = cases
        self.aims = tuple(aims)
        self.holds = tuple(holds)
        self.margin = margin

    @property
    def each(self) -> int:
        """Number of cases."""
        return len(next(iter(self.cases.values()))) if self.cases else 1

    def judge(self, cube: np.ndarray) -> FrontEvaluation:
        """Return the objectives and constraint violations of candidates.

        - `cube`: candidates [candidates dimensions], in [0, 1].
        """
        return evaluate_aims(self.rows(cube, self.cases), self.each, self.aims, self.holds, self.margin)

    def rows(self, cube: np.ndarray, cases: Values) -> Columns:
        """Simulate each candidate on each case, and return the table of rows, candidate by candidate.

        - `cube`: candidates [candidates dimensions], in [0, 1].
        - `cases`: uncertain values of the cases: an array for each path, whose first axis is the case.
        """
        gains = self.gains.values(np.clip(cube, 0.0, BELOW_ONE))
        each = len(next(iter(cases.values()))) if cases else 1
        repeated_gains = {path: np.repeat(array, each, axis=0) for path, array in gains.items()}
        repeated_cases = {path: np.concatenate([array] * len(cube)) for path, array in cases.items()}
        return self.evaluator.values({**repeated_cases, **repeated_gains})


def evaluate_aims(
    columns: Columns, each: int, aims: Sequence[str], holds: Sequence[Predicate], margin: float
) -> FrontEvaluation:
    """Return the objectives and constraint violations of candidates from their rows.

    - `columns`: table of the rows, candidate by candidate.
    - `each`: number of rows per candidate.
    - `aims`, `holds`, `margin`: as in `CaseEvaluator`.

    Raises DefinitionError if there is no such metric, or if a larger value of it is better.
    """
    for aim in aims:
        require_metric(aim, columns, "aims")
        if aim in COUNTS:
            raise DefinitionError(
                f"`{aim}` counts samples and is 0 in a good run: require it by `holds: {aim} < 1`", where="aims"
            )
        if aim in LARGER_IS_BETTER:
            raise DefinitionError(
                f"aims are minimised, and a larger `{aim}` is better: require it by `holds: {aim} > 0.1`", where="aims"
            )
    means = np.stack([columns[aim].reshape(-1, each).mean(axis=1) for aim in aims], axis=1)
    failing = np.zeros(len(columns["outcome"]))
    for item in holds:
        failing += ~item.holds(columns)
    # The number of failures and the missing margin both guide the search to feasible gains.
    shortfall = np.where(np.isfinite(columns["margin"]), margin - columns["margin"], -np.inf)
    count = failing.reshape(-1, each).sum(axis=1)
    return FrontEvaluation(
        means, np.where(count > 0, count + np.maximum(0.0, _most(shortfall, each)), _most(shortfall, each))
    )


def point_of_own_values(space: Space) -> np.ndarray:
    """Return the point of the unit cube at which the gains are the scenario's own [dimensions].

    An own value outside its set gives the nearest coordinate; a gain without a value gives 0.5.

    - `space`: sets of the gains; their values must increase with the coordinates.
    """
    low, high = np.zeros(space.dimensions), np.ones(space.dimensions)
    for _ in range(50):
        middle = 0.5 * (low + high)
        rises = _below_own(space, middle)
        low, high = np.where(rises, middle, low), np.where(rises, high, middle)
    known = np.concatenate([np.full(width, space.leaves[path].own is not None) for path, width in space.widths.items()])
    return np.where(known, 0.5 * (low + high), 0.5)


def _below_own(space: Space, point: np.ndarray) -> np.ndarray:
    values, result = space.values(np.clip(point, 0.0, BELOW_ONE)[None]), []
    for path, width in space.widths.items():
        own = space.leaves[path].own
        if own is None:
            result.append(np.zeros(width, bool))
            continue
        value = values[path][0]
        shape = np.broadcast_shapes(np.shape(value), np.shape(own))
        below = np.broadcast_to(value, shape) - np.broadcast_to(own, shape)
        result.append(below.reshape(-1) < 0 if below.size == width else np.full(width, below.mean() < 0))
    return np.concatenate(result)


def _most(numbers: np.ndarray, each: int) -> np.ndarray:
    most: np.ndarray = numbers.reshape(-1, each).max(axis=1)
    # Without an envelope there is no margin to violate.
    return np.where(np.isfinite(most), most, -1.0)


def rows_of(columns: Columns, first: int, last: int | None) -> Columns:
    """Return the rows `first` to `last`, exclusive, of a table; all from `first` on if `last` is None."""
    return {name: array[first:last] for name, array in columns.items()}


@dataclass(frozen=True)
class Candidate:
    """Score of one set of gains on the held-out cases.

    - `aims`: mean of each metric, by its key.
    - `failures`, `runs`: number of cases in which a property failed, and of all cases.
    - `holding`: confidence interval of the probability that all properties hold.
    """

    aims: dict[str, float]
    failures: int
    runs: int
    holding: Interval


@dataclass(frozen=True)
class TuneResult(AbstractResult):
    """Result of a search for gains.

    - `aims`, `holds`, `confidence`, `seed`: as in `Tune`.
    - `base`: description of the scenario with the current gains.
    - `front`: the Pareto front, with objectives on the training cases.
    - `gains`: gains of each candidate on the front, by path.
    - `before`: objectives of the scenario's current gains on the training cases [aims].
    - `today`: rows of the current gains on the held-out cases.
    - `held_out`: rows of the front on the held-out cases, candidate by candidate; None if the front is empty.
    - `table`: all rows except those of the current gains.
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
        """Index of the best candidate on the front; None if the front is empty.

        The best candidate has the smallest `max(objective/current objective)` on the training cases.
        """
        if not len(self.gains):
            return None
        reference = np.where(np.isfinite(self.before), self.before, self.front.aims.min(axis=0))
        return int(np.argmin(np.max(self.front.aims / reference, axis=1)))

    @property
    def ended(self) -> str:
        """The sentence “n of N candidates hold in all cases”: n candidates violate no property in any training case."""
        if not len(self.gains):
            return f"none of {self.front.evaluations} candidates holds in all cases"
        return f"{self.front.holding} of {self.front.evaluations} candidates hold in all cases"

    def rows(self, index: int | None) -> Columns:
        """Return the rows of a candidate on the held-out cases.

        - `index`: index of a candidate on the front; None for the current gains.
        """
        if index is None or self.held_out is None:
            return self.today
        each = len(self.today["row"])
        return rows_of(self.held_out, index * each, (index + 1) * each)

    def judged(self, index: int | None) -> Candidate:
        """Return the score of a candidate on the held-out cases.

        - `index`: index of the candidate on the front; None for the current gains.
        """
        rows = self.rows(index)
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

    def difference(self, index: int, aim: str) -> PairedDifference:
        """Return statistics of an objective's difference, candidate minus current gains, over the held-out cases.

        - `index`: index of the candidate on the front.
        - `aim`: key of the objective's metric.
        """
        return paired_difference(self.rows(index)[aim], self.today[aim], self.confidence, seed=self.seed)

    @property
    def good(self) -> bool:
        """True if all properties hold in all held-out cases with the best gains."""
        return self.best is not None and not self.judged(self.best).failures

    @property
    def summary(self) -> str:
        if self.best is None:
            return f"No gains satisfy all properties: {self.ended}."
        now, then = self.judged(self.best), self.judged(None)
        text = [f"{now.aims[aim] / then.aims[aim]:.3g} times the {aim}" for aim in self.aims if then.aims[aim] > 0]
        failed = f"{now.failures} of {now.runs} held-out cases fail, with today's gains {then.failures}"
        compared = f"the best gains have {', '.join(text)} of today's gains; " if text else ""
        return f"On held-out cases {compared}{failed} ({self.ended})."

    @property
    def _names(self) -> list[str]:
        return [f"front-{index + 1}" for index in range(len(self.gains))]

    def scenarios(self) -> dict[str, ScenarioDescription]:
        """Return the scenarios with the best gains, `best`, and with the front's gains, `front-1`, ..., by name."""
        built = [alter_description(self.base, gains) for gains in self.gains]
        best = {} if self.best is None else {"best": built[self.best]}
        return {**best, **dict(zip(self._names, built, strict=True))}

    def sections(self) -> list[Section]:
        """Return the sections on the front, its gains, and the difference between the best and the current gains."""
        indices: list[int | None] = [None, *range(len(self.gains))]
        judged = {index: self.judged(index) for index in indices}
        names = {index: "today" if index is None else self._names[index] for index in indices}
        rows: list[list[Cell]] = [
            [
                names[index] + (", best" if index is not None and index == self.best else ""),
                *item.aims.values(),
                item.failures,
                share(item.holding.lower),
            ]
            for index, item in judged.items()
        ]
        note = f"Means over {count_noun(judged[None].runs, 'held-out case')}; {self.ended}."
        head = ("Gains", *self.aims, "Failed", "Holds at least")
        figures = []
        if self.gains:
            front = np.array([list(judged[index].aims.values()) for index in range(len(self.gains))])
            today = np.array(list(judged[None].aims.values()))
            drawing = ([_label(aim) for aim in self.aims], front, today, self.best)
            figures = [Chart("front", "The front", "Means over held-out cases.", "pareto_front", drawing)]
        result = [Section("The front", note, head, rows, figures)]
        if self.best is None:
            return result
        paths = list(self.gains[0])
        values = [
            [names[index], *(_short(self.gains[index][path]) for path in paths)] for index in range(len(self.gains))
        ]
        result.append(
            Section(
                "Gains of the front",
                "A column is named by the end of its path.",
                ("Gains", *distinct_ends(paths)),
                values,
            )
        )
        differences = []
        for aim in self.aims:
            item = self.difference(self.best, aim)
            low, high = (item.of_mean.lower, item.of_mean.upper) if item.of_mean else (None, None)
            differences.append([aim, item.mean, low, high, item.p_value])
        note = f"Case by case on held-out cases, with {percent(self.confidence)} intervals; < 0 is better than today."
        head = ("Objective", "Difference", "At least", "At most", "p, Wilcoxon")
        return [*result, Section("The best gains compared with today's", note, head, differences)]

    def as_json(self) -> dict[str, Any]:
        front = [self._candidate_as_json(index) for index in range(len(self.gains))]
        best = self.best
        shown = self.judged(best) if best is not None else None
        differences = {aim: self.difference(best, aim) for aim in self.aims} if best is not None else {}
        return {
            "kind": "tune",
            "runs": self.runs,
            "failures": None if shown is None else shown.failures,
            "probability": None if shown is None else interval_of(shown.holding),
            "ended": self.ended,
            "worst": NO_WORST_CASE,
            "today": self._candidate_as_json(None),
            "front": front,
            "best": best,
            "difference": {
                aim: {"mean": item.mean, "interval": None if item.of_mean is None else interval_of(item.of_mean)}
                for aim, item in differences.items()
            },
        }

    def _candidate_as_json(self, index: int | None) -> dict[str, Any]:
        judged = self.judged(index)
        points = self.before if index is None else self.front.aims[index]
        return {
            "gains": None if index is None else self.gains[index],
            "search": {aim: float(value) for aim, value in zip(self.aims, points, strict=True)},
            "held_out": {**judged.aims, "failures": judged.failures, "runs": judged.runs},
            "holding": interval_of(judged.holding),
            "scenario": None if index is None else f"{self._names[index]}.yaml",
        }


def _label(aim: str) -> str:
    for item in METRICS:
        if item.key == aim:
            return f"{item.title}  [{item.unit.format(position='rad or m', torque='N m or N')}]"
    return aim


def distinct_ends(paths: Sequence[str]) -> list[str]:
    """Return each path's shortest end, such as `surface.k1`, that no other path ends with."""
    words = [path.split(".") for path in paths]

    def shared(end: list[str]) -> bool:
        return sum(other[-len(end) :] == end for other in words) > 1

    ends = [next((word[-k:] for k in range(1, len(word)) if not shared(word[-k:])), word) for word in words]
    return [".".join(end) for end in ends]


def _short(value: Any) -> str:
    numbers = np.atleast_1d(np.asarray(value, float)).ravel()
    return ", ".join(f"{number:.4g}" for number in numbers)


AIMS = ("steady_error", "steady_torque_step", "peak_torque")


class Tune(AbstractStudy):
    """Searches for gains on random training cases, and scores the best gains on held-out cases.

    Every candidate, a set of gains, runs on the same training cases. Candidates that violate a property in a case are
    discarded. Of the others the Pareto front is kept. The front and the current gains are scored on held-out cases.
    """

    study: Literal["tune"]
    gains: Annotated[Uncertainty, Field(min_length=1)]
    """Sets of the tuned values by path, such as `scheme.surface.k1: {between: [0.1, 2]}`."""
    aims: Annotated[tuple[str, ...], Field(min_length=1)] = AIMS
    """Metrics to minimise, as means over the cases."""
    holds: tuple[str, ...] = (ENVELOPE,)
    """Properties that must hold in every case: `envelope`, or a condition such as `steady_error < 1e-3`."""
    margin: float = input_field(
        "least envelope margin in every training case, as a reserve for other cases", "", "[0, 1)", default=0.0
    )
    cases: Annotated[int, Field(ge=1, le=100_000)] = 16
    """Number of training cases; without uncertainty there is a single case."""
    candidates: Annotated[int, Field(ge=1, le=10_000_000)] = 600
    """Largest number of candidates."""
    seconds: float | None = input_field(
        "time after which no batch begins; the rows then depend on the machine", "s", "> 0", default=None
    )
    held_out: Annotated[int, Field(ge=1, le=10_000_000)] = 200
    """Number of held-out cases."""
    keep: Annotated[int, Field(ge=1, le=1000)] = 12
    """Number of candidates to keep, spread along the front."""
    confidence: float = input_field("confidence of the intervals", "", "(0, 1)", default=0.95)

    def run(self, how: RunOptions) -> TuneResult:
        holds = [Predicate(text) for text in self.holds]
        family = self.family(self.gains)
        known, unseen = self._cases(family)
        runner = self.runner(family, how)
        evaluated = BatchEvaluator(runner, family)
        on = CaseEvaluator(evaluated, family.varied, known, self.aims, holds, self.margin)
        how.begin((self.candidates + 1) * on.each + (self.keep + 1) * self._each(unseen))
        today = self._today(how, known, unseen)
        before = evaluate_aims(rows_of(today, 0, on.each), on.each, self.aims, holds, self.margin)
        front = pareto_search(
            on.judge,
            family.varied.dimensions,
            evaluations=self.candidates,
            start=point_of_own_values(family.varied),
            seed=self.seed,
            seconds=self.seconds,
            most=self.keep,
        )
        table = on.rows(front.points, unseen) if len(front.points) else None
        return TuneResult(
            aims=self.aims,
            holds=self.holds,
            confidence=self.confidence,
            seed=self.seed,
            base=self.described(),
            front=front,
            gains=self._chosen(family, front),
            before=before.aims[0],
            today=rows_of(today, on.each, None),
            held_out=table,
            **evaluated.collected(),
        )

    def _cases(self, family: Family) -> tuple[Values, Values]:
        """Return the uncertain values of the training cases and of the held-out cases."""
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

    def _today(self, how: RunOptions, known: Values, unseen: Values) -> Columns:
        """Simulate the current gains on all cases, and return the table of rows, training cases first."""
        family = self.family()
        runner = self.runner(family, replace(how, out=None if how.out is None else Path(how.out, "today")))
        both = {path: np.concatenate([known[path], unseen[path]]) for path in known}
        # Without uncertainty a single run serves as training and held-out case.
        columns = runner.rows(0, both) if both else runner.rows(0, {})
        if runner.store is not None:
            runner.store.finish(len(columns["row"]))
        return columns if both else {name: np.concatenate([array, array]) for name, array in columns.items()}

    def _chosen(self, family: Family, front: Front) -> list[dict[str, Any]]:
        values = family.varied.values(np.clip(front.points, 0.0, BELOW_ONE)) if len(front.points) else {}
        return [as_changes({path: array[k] for path, array in values.items()}) for k in range(len(front.points))]
