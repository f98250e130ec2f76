"""Metrics as a data frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slidax.simulation import Run
from slidax.simulation.frames import Kind, data_frame

from .metric import Metric
from .summary import metrics_of


def frame(runs: Run | Mapping[str, Run], kind: Kind = "pandas", also: Sequence[Metric[Any]] = ()) -> Any:
    """All metrics as a data frame, one row for each number: columns `run`, `metric`, `joint`, `unit`, `value`.

    `run` is the number of a run, from 0, or its name; `joint` is the joint's name, and empty for a metric of the whole
    run. Missing values are NaN in pandas, null in polars.

    - `runs`: one run, many of `simulate_batch`, or several by name, such as one for each scheme.
    - `kind`: "pandas" or "polars".
    - `also`: further metrics, such as those of a paper.

    Raises DefinitionError if the library is another, or is not installed.
    """
    named = runs if isinstance(runs, Mapping) else _numbered(runs)
    rows = [row for name, run in named.items() for row in _rows(name, run, also)]
    names = ("run", "metric", "joint", "unit", "value")
    columns: dict[str, Any] = dict(zip(names, zip(*rows, strict=True) if rows else [()] * len(names), strict=True))
    if kind == "pandas":
        columns["value"] = np.array([np.nan if value is None else value for value in columns["value"]])
    return data_frame(columns, kind)


def _numbered(runs: Run) -> dict[int, Run]:
    return {0: runs} if not np.ndim(runs.period) else dict(enumerate(runs))


def _rows(name: Any, run: Run, also: Sequence[Metric[Any]]) -> list[tuple[Any, ...]]:
    rows: list[tuple[Any, ...]] = []
    for metric in (*metrics_of(run), *also):
        if metric.per_joint:
            each = zip(run.joint_names, metric.units(run), metric.shown(run), strict=True)
            rows += [(name, metric.key, joint, unit, value) for joint, unit, value in each]
            continue
        value = metric(run)
        number = None if value is None or not np.isfinite(value) else float(value)
        rows.append((name, metric.key, "", metric.units(run)[0], number))
    return rows
