"""Joint torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax.simulation import Run

from .axes import use_time_axis
from .limits import draw_limit, limit_handle
from .logged import joint_label, log_of
from .style import LINES, ROW, WIDTH, legend_above, styled
from .thinning import thinned


@styled
def torque(run: Run, *, limits: Sequence[float] | np.ndarray | None = None, beginning: float = 2.0) -> Figure:
    """Per joint: the torque over the whole run, and to the right over its beginning.

    - `run`: with a log.
    - `limits`: largest torque of each joint's drive [N m or N].
    - `beginning`: [s].

    Raises DefinitionError if the run has no log.
    """
    log = log_of(run)
    t, tau = np.asarray(log.t), np.asarray(log.tau)
    first = t <= max(beginning, float(t[1]))
    figure = Figure(figsize=(WIDTH, ROW * run.joints + 0.25), layout="constrained")
    panels = figure.subplots(run.joints, 2, sharex="col", squeeze=False, width_ratios=[1.6, 1])
    for i, unit in enumerate(run.torque_units):
        whole, zoomed = panels[i]
        whole.plot(*thinned(t, tau[:, i]), **LINES[0])
        zoomed.plot(*thinned(t[first], tau[first, i]), **LINES[0])
        whole.set_ylabel(joint_label(run, i, r"\tau_{%d}", unit))
        for axes in (whole, zoomed):
            axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
            axes.margins(y=0.08)
        if limits is not None:
            draw_limit(panels[i], float(limits[i]), unit)
    for axes, end in zip(panels[-1], (t[-1], t[first][-1]), strict=True):
        use_time_axis(axes, float(t[0]), float(end))
    if limits is not None:
        legend_above(figure, [Line2D([], [], **LINES[0], label="torque"), limit_handle()])
    figure.align_ylabels()
    return figure
