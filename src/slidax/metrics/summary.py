"""All metrics of a run, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from slidax.simulation import Run

from . import effort, envelope, error
from . import promise as promises
from . import tool as tools
from . import tube as tolerance_metrics
from .metric import Metric

METRICS: tuple[Metric[Any], ...] = tuple(
    thing for module in (error, effort, envelope) for thing in vars(module).values() if isinstance(thing, Metric)
)
"""Every metric in the order of tables, except settling times, which depend on a run's bands, and tolerance metrics."""

OF_TOLERANCES: tuple[Metric[Any], ...] = (tolerance_metrics.tolerance_violations, tolerance_metrics.tolerance_margin)
"""Metrics of a run with a tolerance band."""


OF_TOOLS: tuple[Metric[Any], ...] = tuple(thing for thing in vars(tools).values() if isinstance(thing, Metric))
"""What a run has besides whose joints lead a tool; the turns, if the robot says how its tip is turned."""


OF_MONITORS: tuple[Metric[Any], ...] = (promises.promise_margin, promises.warned_at)
"""What a run whose law has a monitor has besides."""


def metrics_of(run: Run) -> tuple[Metric[Any], ...]:
    """Every metric of a run, the settling times first.

    - `run`: a finished run, or a batch.
    """
    besides = (
        *(one for one in OF_TOOLS if one(run) is not None),
        *(OF_TOLERANCES if run.tally.tolerance is not None else ()),
        *(OF_MONITORS if run.tally.promise is not None else ()),
    )
    return (*error.settling_times(run), *METRICS, *besides)


def summary(run: Run, also: Sequence[Metric[Any]] = ()) -> dict[str, Any]:
    """Every metric by its key; lists have one entry per joint, and those of a batch one list per run.

    What is not known, or not finite, is None.

    - `run`: a finished run, or a batch.
    - `also`: further metrics, such as those of a paper.
    """
    found: dict[str, Any] = {}
    for metric in (*metrics_of(run), *also):
        value = metric(run)
        group, _, name = metric.key.partition(".")
        place = found.setdefault(group, {}) if name else found
        place[name or group] = _plain(value.tolist() if hasattr(value, "tolist") else value)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
