"""Predicted and measured torques."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from slidax.identification import Identification

from .axes import use_time_axis
from .style import BAND, LINES, ROW, WIDTH, legend_above, styled
from .thinning import thinned


@styled
def identified_torques(identification: Identification) -> Figure:
    """Per joint: measured, predicted and remaining torque of an `identification`; the held-out part is shaded."""
    t, n = identification.t - identification.t[0], identification.robot.joints
    figure = Figure(figsize=(WIDTH, ROW * n + 0.25), layout="constrained")
    panels = figure.subplots(n, 2, sharex="col", squeeze=False, width_ratios=[1.6, 1])
    left = identification.measured - identification.predicted
    for i, unit in enumerate(identification.robot.torque_units):
        whole, rest = panels[i]
        whole.plot(*thinned(t, identification.measured[:, i]), **LINES[0])
        whole.plot(*thinned(t, identification.predicted[:, i]), **LINES[1])
        rest.plot(*thinned(t, left[:, i]), **LINES[2])
        largest = max(float(np.abs(left[:, i]).max()), 1e-12)
        rest.set_ylim(-1.1 * largest, 1.1 * largest)
        whole.set_ylabel(rf"$\tau_{{{i + 1}}}$  [{unit}]")
        for axes in (whole, rest):
            axes.axvspan(float(t[identification.split]), float(t[-1]), zorder=0.5, **BAND)
            axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
    for axes in panels[-1]:
        use_time_axis(axes, 0.0, float(t[-1]))
    names = ("measured", "predicted", "difference")
    lines = [Line2D([], [], **look, label=name) for look, name in zip(LINES, names, strict=False)]
    legend_above(figure, [*lines, Patch(facecolor=BAND["facecolor"], edgecolor="0.6", label="held out")])
    figure.align_ylabels()
    return figure
