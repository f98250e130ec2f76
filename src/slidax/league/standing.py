"""Who is best on a task, and how surely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slidax.studies.statistics import Interval, clopper_pearson, paired_difference, paired_shares

from .entry import Entry
from .match import Match

CONFIDENCE = 0.95
"""Of every interval, and of what is called significant."""


@dataclass(frozen=True)
class Score:
    """What a scheme did on the held-out cases of a task.

    - `entry`: the scheme.
    - `inside`: the share of cases that never left the tolerance band.
    - `interval`: of that share, by Clopper and Pearson.
    - `failed`: the share that was lost.
    - `medians`: of each metric, over the cases that were not lost; None if all were.
    - `behind`: p-value of McNemar's test against the largest share, by Holm over the schemes of the task.
    """

    entry: Entry
    inside: float
    interval: Interval
    failed: float
    medians: Mapping[str, float | None]
    behind: float

    @property
    def leads(self) -> bool:
        """Whether its share is not shown to be smaller than the largest."""
        return self.behind >= 1.0 - CONFIDENCE


@dataclass(frozen=True)
class Standing:
    """A task's table.

    - `task`: its name.
    - `scores`: the best first: by their steady error those that lead, and then the others by their share.
    - `p_value`: of Wilcoxon's test on the steady errors of the first and the second where both lead, else of McNemar's.
    - `by`: what tells the first from the second.
    """

    task: str
    scores: Sequence[Score]
    p_value: float
    by: str

    @property
    def best(self) -> Score | None:
        """The first, if any scheme kept the tolerance band in some case."""
        return self.scores[0] if self.scores and self.scores[0].inside > 0 else None


def standing(task: str, matches: Mapping[Entry, Match]) -> Standing:
    """The table of a task.

    - `task`: its name.
    - `matches`: of the schemes on it.
    """
    if not matches:
        return Standing(task, (), 1.0, "")
    shares = {entry: float(match.inside.mean()) for entry, match in matches.items()}
    errors = {entry: _median(match, "steady_error") for entry, match in matches.items()}
    top = min(matches, key=lambda entry: (-shares[entry], _sortable(errors[entry])))
    others = [entry for entry in matches if entry != top]
    raw = [paired_shares(matches[top].inside, matches[entry].inside, CONFIDENCE).p_value for entry in others]
    behind = {top: 1.0, **dict(zip(others, holm(raw), strict=True))}
    scores = [_score(entry, matches[entry], behind[entry]) for entry in matches]
    scores.sort(key=lambda one: (0.0, _sortable(errors[one.entry])) if one.leads else (1.0, -one.inside))
    if len(scores) < 2:
        return Standing(task, scores, 1.0, "")
    first, second = (matches[one.entry] for one in scores[:2])
    if not scores[1].leads:
        return Standing(task, scores, scores[1].behind, "share inside")
    both = ~first.failed & ~second.failed
    ours, theirs = (np.where(both, match.metrics["steady_error"], np.nan) for match in (first, second))
    p_value = paired_difference(ours, theirs, CONFIDENCE).p_value
    return Standing(task, scores, 1.0 if p_value is None else p_value, "steady error")


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values of several tests, so that it is unlikely that any of those below α is wrong (S. Holm, 1979).

    - `p_values`: of each test by itself.
    """
    order = np.argsort(p_values, kind="stable")
    adjusted, highest = np.ones(len(p_values)), 0.0
    for place, which in enumerate(order):
        highest = max(highest, min(1.0, (len(p_values) - place) * p_values[which]))
        adjusted[which] = highest
    return [float(value) for value in adjusted]


def _score(entry: Entry, match: Match, behind: float) -> Score:
    runs, outside = len(match.inside), int((~match.inside).sum())
    failing = clopper_pearson(outside, runs, CONFIDENCE)
    medians = {name: _median(match, name) for name in match.metrics}
    inside = Interval(1.0 - failing.upper, 1.0 - failing.lower, CONFIDENCE)
    return Score(entry, 1.0 - outside / runs, inside, float(match.failed.mean()), medians, behind)


def _median(match: Match, name: str) -> float | None:
    values = match.metrics[name][~match.failed]
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else None


def _sortable(value: float | None) -> float:
    return np.inf if value is None else value
