"""Error sizes of several runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax._errors import DefinitionError
from slidax.simulation import Run

from .axes import use_size_axis, use_time_axis
from .logged import joint_label, log_of
from .style import LINES, ROW, WIDTH, legend_above, styled
from .thinning import thinned

LEVEL: dict[str, Any] = {"color": "0.1", "linewidth": 0.7, "linestyle": "-", "zorder": 3}


@styled
def error_sizes(runs: Mapping[str, Run], *, levels: Mapping[str, Sequence[float]] | None = None) -> Figure:
    """Per joint: the size of each run's error on a logarithmic axis, with levels for comparison.

    - `runs`: with logs, by name.
    - `levels`: horizontal lines by name, one value per joint [rad or m].

    Raises DefinitionError if there are no runs, more than five, or one without a log.
    """
    if not 1 <= len(runs) <= len(LINES):
        raise DefinitionError(f"this figure shows 1 to {len(LINES)} runs; got {len(runs)}")
    first = next(iter(runs.values()))
    logs = [log_of(run) for run in runs.values()]
    figure = Figure(figsize=(WIDTH, ROW * 1.1 * first.joints + 0.55), layout="constrained")
    panels = figure.subplots(first.joints, 1, sharex=True, squeeze=False)[:, 0]
    use_size_axis(panels, np.concatenate([np.abs(np.asarray(log.e)).ravel() for log in logs]))
    for i, (axes, unit) in enumerate(zip(panels, first.joint_units, strict=True)):
        for log, line in zip(logs, LINES, strict=False):
            axes.plot(*thinned(np.asarray(log.t), np.abs(np.asarray(log.e)[:, i])), **{**line, "linewidth": 0.9})
        for level in (levels or {}).values():
            axes.axhline(level[i], **LEVEL)
        axes.set_ylabel(joint_label(first, i, "|e_{%d}|", unit))
    use_time_axis(panels[-1], 0.0, max(float(log.t[-1]) for log in logs))
    handles = [Line2D([], [], **line, label=name) for name, line in zip(runs, LINES, strict=False)]
    handles += [Line2D([], [], **LEVEL, label=name) for name in levels or {}]
    legend_above(figure, handles)
    figure.align_ylabels()
    return figure
