"""Rankings of the benchmark: the best scheme on a task, its significance, and each scheme over all tasks.

A scheme leads a task if its share of cases inside the tolerance band is not significantly below the largest share. A
case is lost if its run ended early, or its steady error exceeds the band's initial radius.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..statistics import Interval, clopper_pearson, paired_difference, paired_shares
from .entries import BenchmarkEntry
from .rounds import TaskResult

CONFIDENCE = 0.95
"""Confidence of all intervals and tests."""


@dataclass(frozen=True)
class Score:
    """Score of an `entry` on the held-out cases of a task.

    - `inside`, `interval`: share of cases that never left the tolerance band, with Clopper and Pearson's interval.
    - `failed`: share of lost cases.
    - `medians`: median of each metric over the cases that were not lost, by key; None if all were lost.
    - `behind`: p-value of McNemar's test against the scheme with the largest share inside. Holm's method adjusts the
      p-value for the number of schemes. A small value means a significantly smaller share.
    """

    entry: BenchmarkEntry
    inside: float
    interval: Interval
    failed: float
    medians: Mapping[str, float | None]
    behind: float

    @property
    def leads(self) -> bool:
        """True if the share of cases inside is not significantly smaller than the task's largest."""
        return self.behind >= 1.0 - CONFIDENCE


@dataclass(frozen=True)
class Ranking:
    """Ranking of the schemes on a `task`.

    - `scores`: the best first: leading schemes by their median steady error, then the others by their share inside.
    - `p_value`: significance of the difference between the first two schemes. If both lead, it is from Wilcoxon's test
      on their steady errors, else from McNemar's test on their shares inside.
    - `by`: criterion that ranks the first scheme before the second: `steady error` or `share inside`.
    """

    task: str
    scores: Sequence[Score]
    p_value: float
    by: str

    @property
    def best(self) -> Score | None:
        """The first score; None if no scheme kept the tolerance band in any case."""
        return self.scores[0] if self.scores and self.scores[0].inside > 0 else None


def ranking(task: str, results: Mapping[BenchmarkEntry, TaskResult]) -> Ranking:
    """Return the ranking of the schemes on a `task`, by their `results`."""
    if not results:
        return Ranking(task, (), 1.0, "")
    shares = {entry: float(result.inside.mean()) for entry, result in results.items()}
    errors = {entry: _median(result, "steady_error") for entry, result in results.items()}
    top = min(results, key=lambda entry: (-shares[entry], _sortable(errors[entry])))
    others = [entry for entry in results if entry != top]
    raw = [paired_shares(results[top].inside, results[entry].inside, CONFIDENCE).p_value for entry in others]
    behind = {top: 1.0, **dict(zip(others, holm(raw), strict=True))}
    scores = [_score(entry, results[entry], behind[entry]) for entry in results]
    scores.sort(key=lambda score: (0.0, _sortable(errors[score.entry])) if score.leads else (1.0, -score.inside))
    if len(scores) < 2:
        return Ranking(task, scores, 1.0, "")
    first, second = (results[score.entry] for score in scores[:2])
    if not scores[1].leads:
        return Ranking(task, scores, scores[1].behind, "share inside")
    both = ~first.failed & ~second.failed
    ours, theirs = (np.where(both, result.metrics["steady_error"], np.nan) for result in (first, second))
    p_value = paired_difference(ours, theirs, CONFIDENCE).p_value
    return Ranking(task, scores, 1.0 if p_value is None else p_value, "steady error")


def holm(p_values: Sequence[float]) -> list[float]:
    """Return the p-values of several tests, adjusted to bound the family-wise error rate (S. Holm, 1979)."""
    order = np.argsort(p_values, kind="stable")
    adjusted, highest = np.ones(len(p_values)), 0.0
    for rank, test in enumerate(order):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[test]))
        adjusted[test] = highest
    return [float(value) for value in adjusted]


def _score(entry: BenchmarkEntry, result: TaskResult, behind: float) -> Score:
    runs, outside = len(result.inside), int((~result.inside).sum())
    failing = clopper_pearson(outside, runs, CONFIDENCE)
    medians = {name: _median(result, name) for name in result.metrics}
    inside = Interval(1.0 - failing.upper, 1.0 - failing.lower, CONFIDENCE)
    return Score(entry, 1.0 - outside / runs, inside, float(result.failed.mean()), medians, behind)


def _median(result: TaskResult, name: str) -> float | None:
    values = result.metrics[name][~result.failed]
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else None


def _sortable(value: float | None) -> float:
    return np.inf if value is None else value


@dataclass(frozen=True)
class Overall:
    """Summary of a scheme over all tasks.

    - `tasks`: number of tasks on which it ran.
    - `best`, `leads`: number of tasks on which the scheme is first, and on which it leads.
    - `inside`, `failed`: shares of cases inside the tolerance band, and of lost cases, averaged over the tasks.
    - `error`: median steady error relative to the task's least, as geometric mean over the tasks; None without results.
    - `step`: median steady torque step, summarised in the same way.
    """

    entry: BenchmarkEntry
    tasks: int
    best: int
    leads: int
    inside: float
    failed: float
    error: float | None
    step: float | None

    def numbers(self) -> dict[str, float | int | None]:
        """Return all fields except `entry`, by name."""
        return {name: value for name, value in vars(self).items() if name != "entry"}


def rank_overall(tables: Sequence[Ranking], entries: Sequence[BenchmarkEntry]) -> list[Overall]:
    """Return a summary of each scheme over all tasks, sorted by tasks on which it leads, then by share inside.

    - `tables`: rankings of the tasks.
    - `entries`: the schemes; one without results is left out.
    """
    summaries = [each for each in (_of(entry, tables) for entry in entries) if each is not None]
    return sorted(summaries, key=lambda each: (-each.leads, -each.inside))


def _of(entry: BenchmarkEntry, tables: Sequence[Ranking]) -> Overall | None:
    scores = [(table, score) for table in tables for score in table.scores if score.entry == entry]
    if not scores:
        return None
    return Overall(
        entry=entry,
        tasks=len(scores),
        best=sum(table.best is score for table, score in scores),
        leads=sum(score.leads and score.inside > 0 for _, score in scores),
        inside=float(np.mean([score.inside for _, score in scores])),
        failed=float(np.mean([score.failed for _, score in scores])),
        error=_relative(entry, tables, "steady_error"),
        step=_relative(entry, tables, "steady_torque_step"),
    )


def _relative(entry: BenchmarkEntry, tables: Sequence[Ranking], name: str) -> float | None:
    ratios = []
    for table in tables:
        known = {score.entry: value for score in table.scores if (value := score.medians[name])}
        if entry in known:
            ratios.append(known[entry] / min(known.values()))
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else None
