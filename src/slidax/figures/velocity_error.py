"""Velocity errors."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from slidax.simulation import Run

from .axes import use_size_axis, use_time_axis
from .logged import joint_label, log_of
from .style import LINES, ROW, WIDTH, styled
from .thinning import thinned


@styled
def velocity_error(run: Run, *, beginning: float = 2.0) -> Figure:
    """Per joint: the velocity error over the beginning, and to the right its size over the whole run.

    - `run`: with a log.
    - `beginning`: [s].

    Raises DefinitionError if the run has no log.
    """
    log = log_of(run)
    t, de = np.asarray(log.t), np.asarray(log.de)
    first = t <= max(beginning, float(t[1]))
    figure = Figure(figsize=(WIDTH, ROW * run.joints + 0.25), layout="constrained")
    panels = figure.subplots(run.joints, 2, sharex="col", squeeze=False, width_ratios=[1, 1.15])
    use_size_axis(panels[:, 1], np.abs(de))
    for i, unit in enumerate(run.joint_units):
        plain, logarithmic = panels[i]
        plain.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
        plain.plot(*thinned(t[first], de[first, i]), **LINES[0])
        plain.set_ylabel(joint_label(run, i, r"\dot{e}_{%d}", f"{unit}/s"))
        logarithmic.plot(*thinned(t, np.abs(de[:, i])), **{**LINES[0], "linewidth": 0.9})
        logarithmic.set_ylabel(rf"$|\dot{{e}}_{{{i + 1}}}|$  [{unit}/s]")
    for axes, end in zip(panels[-1], (t[first][-1], t[-1]), strict=True):
        use_time_axis(axes, float(t[0]), float(end))
    figure.align_ylabels()
    return figure
