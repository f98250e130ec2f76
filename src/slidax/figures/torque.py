"""What the joints are asked for."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from slidax.simulation import Run

from .axes import use_time_axis
from .logged import log_of, torque_unit
from .style import LINES, ROW, WIDTH, styled
from .thinning import thinned


@styled
def torque(run: Run, *, beginning: float = 2.0) -> Figure:
    """Per joint: the torque over the whole run, and to the right over its beginning.

    - `run`: a finished run with a log.
    - `beginning`: how long the beginning is [s].

    Raises DefinitionError if the run has no log.
    """
    log = log_of(run)
    t, tau = np.asarray(log.t), np.asarray(log.tau)
    first = t <= max(beginning, float(t[1]))
    figure = Figure(figsize=(WIDTH, ROW * run.joints + 0.25), layout="constrained")
    panels = figure.subplots(run.joints, 2, sharex="col", squeeze=False, width_ratios=[1.6, 1])
    for i, unit in enumerate(run.joint_units):
        whole, zoomed = panels[i]
        whole.plot(*thinned(t, tau[:, i]), **LINES[0])
        zoomed.plot(*thinned(t[first], tau[first, i]), **LINES[0])
        whole.set_ylabel(rf"$\tau_{{{i + 1}}}$  [{torque_unit(unit)}]")
        for axes in (whole, zoomed):
            axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
            axes.margins(y=0.08)
    for axes, end in zip(panels[-1], (t[-1], t[first][-1]), strict=True):
        use_time_axis(axes, float(t[0]), float(end))
    figure.align_ylabels()
    return figure
