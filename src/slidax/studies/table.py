"""Runs as columns of a table: one row per case, no longer than a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from slidax.metrics import METRICS, OF_MONITORS, OF_TOLERANCES, OF_TOOLS, metrics_of
from slidax.simulation import Run

Columns: TypeAlias = dict[str, NDArray[Any]]
"""Columns by name, each with one entry per case."""

OUTCOMES = ("ok", "left_envelope", "not_finite", "recovered")
"""Meanings of the numbers in the column `outcome`."""

COLUMNS = {
    "row": "number of the case",
    "outcome": f"place in {', '.join(OUTCOMES)}",
    "t": "when it ended badly or left its envelope [s]",
    "joint": "which joint did, from 1; that with the least margin in a run that is ok",
    "margin": "least distance to the nearer bound over the envelope's width; negative if it was outside",
    **{
        metric.key: f"{metric.title}, of the worst joint [{metric.unit.format(position='rad or m', torque='N m or N')}]"
        for metric in (*METRICS, *OF_TOOLS, *OF_TOLERANCES, *OF_MONITORS)
    },
}
"""Meanings of the columns of a table."""


def columns_of(run: Run) -> Columns:
    """Outcome and metrics of each run.

    - column `outcome`: its place in `OUTCOMES`; `t`: when that was [s]; `joint`: which, counted from 1, or that with
      the least margin in a run that is ok.
    - column `margin`: least distance to the nearer bound over the envelope's width, in any joint; negative for every
      run that was outside, the lower the earlier it ended.
    - all metrics of `slidax.metrics` by their keys, of the worst joint.

    Missing values are NaN.

    - `run`: many runs, or one.
    """
    single = not np.ndim(run.period)
    tally, fault = run.tally, run.fault
    kind = np.atleast_1d(np.asarray(fault.kind))
    rows = len(kind)
    outside = np.atleast_1d(np.asarray(tally.violations)) > 0
    outcome = np.where((kind == 0) & outside, OUTCOMES.index("recovered"), kind)
    margins = np.asarray(tally.margin).reshape(rows, -1)
    # A joint that is not finite has no margin, and one without an envelope an infinite one.
    least = np.where(np.isnan(margins), -np.inf, margins)
    margin = least.min(axis=1)
    ended = np.atleast_1d(np.asarray(fault.t)) / np.atleast_1d(np.asarray(run.t1))
    margin = np.where(kind > 0, np.minimum(margin, 0.0) - 1.0 + ended, margin)
    margin = np.where((outcome > 0) & (margin >= 0), -1e-12, margin)
    when = np.where(kind > 0, np.atleast_1d(np.asarray(fault.t)), np.nan)
    joint = np.where(kind > 0, np.atleast_1d(np.asarray(fault.joint)), least.argmin(axis=1)) + 1
    if run.excursion is not None:
        first = np.atleast_1d(np.asarray(run.excursion.first)) * np.atleast_1d(np.asarray(run.period))
        back = outcome == OUTCOMES.index("recovered")
        when = np.where(back, first, when)
        joint = np.where(back, np.atleast_1d(np.asarray(run.excursion.joint)) + 1, joint)
    columns: Columns = {
        "outcome": outcome.astype(np.int8),
        "t": when,
        "joint": joint.astype(np.int16),
        "margin": np.where(np.isfinite(margin), margin, np.nan),
    }
    for item in metrics_of(run):
        value: Any = item(run)
        if value is None:
            columns[item.key] = np.full(rows, np.nan)
            continue
        filled = np.ma.filled(np.ma.asarray(value, float), np.nan)
        numbers = filled.reshape(rows, -1) if not single or item.per_joint else filled.reshape(1, -1)
        worst = _worst(numbers, item.least_is_best)
        columns[item.key] = np.where(np.isfinite(worst), worst, np.nan)
    return columns


def _worst(numbers: NDArray[Any], least_is_best: bool) -> NDArray[Any]:
    return numbers.max(axis=1) if least_is_best else numbers.min(axis=1)


def joined(parts: Sequence[tuple[NDArray[Any], Columns]], rows: int) -> Columns:
    """Columns of groups of rows as one table in the order of the rows.

    - `parts`: each with the numbers of its rows.
    - `rows`: how many there are.
    """
    names = list(dict.fromkeys(name for _, columns in parts for name in columns))
    whole: Columns = {}
    for name in names:
        kinds = [columns[name].dtype for _, columns in parts if name in columns]
        kind = np.result_type(*kinds)
        array = np.full(rows, np.nan, kind) if kind.kind == "f" else np.zeros(rows, kind)
        for where, columns in parts:
            if name in columns:
                array[where] = columns[name]
        whole[name] = array
    return whole


def concatenated(parts: Mapping[int, Columns]) -> Columns:
    """Chunks of rows as one table in the order of the rows.

    - `parts`: by the number of their first row.
    """
    ordered = [parts[first] for first in sorted(parts)]
    return {name: np.concatenate([columns[name] for columns in ordered]) for name in ordered[0]} if ordered else {}
