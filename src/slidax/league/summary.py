"""Summary of each scheme over all tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .entry import BenchmarkEntry
from .standing import Ranking


@dataclass(frozen=True)
class Overall:
    """A scheme over all tasks.

    - `tasks`: number of tasks on which it was run.
    - `best`, `leads`: numbers of tasks on which it is the first, and on which it leads.
    - `inside`, `failed`: shares of the cases, mean over the tasks.
    - `error`: geometric mean over the tasks of its median steady error divided by the task's least; None without any.
    - `step`: the same of its steady torque step.
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
        """Return all fields but the scheme, by name."""
        return {name: value for name, value in vars(self).items() if name != "entry"}


def overall(tables: Sequence[Ranking], entries: Sequence[BenchmarkEntry]) -> list[Overall]:
    """Summarise the schemes over all tasks, sorted by the number of tasks on which they lead, then by share inside."""
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
