"""A scheme over all tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .entry import Entry
from .standing import Standing


@dataclass(frozen=True)
class Overall:
    """A scheme over all tasks.

    - `entry`: the scheme.
    - `tasks`: on how many it was run.
    - `best`, `leads`: on how many it is the first, and on how many its share is not shown to be less than the largest.
    - `inside`, `failed`: shares of the cases, on average over the tasks.
    - `error`: its median steady error over the least one of the task, as a geometric mean over the tasks that have one;
      None without any.
    - `step`: likewise its steady torque step.
    """

    entry: Entry
    tasks: int
    best: int
    leads: int
    inside: float
    failed: float
    error: float | None
    step: float | None

    def numbers(self) -> dict[str, float | int | None]:
        """All but the scheme, by name."""
        return {name: value for name, value in vars(self).items() if name != "entry"}


def overall(tables: Sequence[Standing], entries: Sequence[Entry]) -> list[Overall]:
    """The schemes over all tasks, those first that lead on most, and then by their share inside.

    - `tables`: of the tasks.
    - `entries`: the schemes.
    """
    found = [one for one in (_of(entry, tables) for entry in entries) if one is not None]
    return sorted(found, key=lambda one: (-one.leads, -one.inside))


def _of(entry: Entry, tables: Sequence[Standing]) -> Overall | None:
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


def _relative(entry: Entry, tables: Sequence[Standing], name: str) -> float | None:
    ratios = []
    for table in tables:
        known = {score.entry: value for score in table.scores if (value := score.medians[name])}
        if entry in known:
            ratios.append(known[entry] / min(known.values()))
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else None
