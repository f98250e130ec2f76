"""All metrics of a run, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from slidax.simulation import Run

from .effort import (
    initial_torque,
    max_torque_step,
    peak_torque,
    steady_torque_step,
    steady_torque_step_rms,
    torque_energy,
    torque_travel,
)
from .envelope import envelope_margin, envelope_violations
from .error import iae, rms_error, settling_times, steady_error
from .metric import Metric
from .promise import guarantee_margin, warned_at
from .tool import rms_tool_error, rms_tool_turn, steady_tool_error, steady_tool_turn, tool_error, tool_turn
from .tube import tolerance_margin, tolerance_violations

METRICS: tuple[Metric[Any], ...] = (
    steady_error,
    rms_error,
    iae,
    peak_torque,
    initial_torque,
    max_torque_step,
    steady_torque_step,
    steady_torque_step_rms,
    torque_energy,
    torque_travel,
    envelope_violations,
    envelope_margin,
)
"""Every metric in the order of tables, except settling times, which depend on a run's bands, and tolerance metrics."""

OF_TOLERANCES: tuple[Metric[Any], ...] = (tolerance_violations, tolerance_margin)
"""Metrics of a run with a tolerance band."""


OF_TOOLS: tuple[Metric[Any], ...] = (
    tool_error,
    steady_tool_error,
    rms_tool_error,
    tool_turn,
    steady_tool_turn,
    rms_tool_turn,
)
"""Additional metrics of a run whose arm leads a tool; the turns, if the robot defines its tip's orientation."""


OF_MONITORS: tuple[Metric[Any], ...] = (guarantee_margin, warned_at)
"""Additional metrics of a run whose law has a monitor."""


def metrics_of(run: Run) -> tuple[Metric[Any], ...]:
    """Every metric of a run, the settling times first."""
    besides = (
        *(metric for metric in OF_TOOLS if metric(run) is not None),
        *(OF_TOLERANCES if run.tally.tolerance is not None else ()),
        *(OF_MONITORS if run.tally.promise is not None else ()),
    )
    return (*settling_times(run), *METRICS, *besides)


def summary(run: Run, also: Sequence[Metric[Any]] = ()) -> dict[str, Any]:
    """Every metric by its key; lists have one entry per joint, and those of a batch one list per run.

    Missing and infinite values are None.

    - `also`: further metrics, such as those of a paper.
    """
    values: dict[str, Any] = {}
    for metric in (*metrics_of(run), *also):
        value = metric(run)
        group, _, name = metric.key.partition(".")
        place = values.setdefault(group, {}) if name else values
        place[name or group] = _plain(value.tolist() if hasattr(value, "tolist") else value)
    return values


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
