"""The path of the tip."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import LINES, WIDTH, legend_above, styled

MARKS = {"start": "o", "end": "s"}


@styled
def tip_path(actual: np.ndarray, desired: np.ndarray) -> Figure:
    """The tip's path and the desired one, seen from above, and from the side if the tip also moves vertically.

    - `actual`, `desired`: tip positions over time [k 3], m.
    """
    actual, desired = np.asarray(actual), np.asarray(desired)
    rises = np.ptp(np.concatenate([actual, desired])[:, 2]) > 1e-9
    views = [(0, 1), (0, 2)] if rises else [(0, 1)]
    spans = np.ptp(np.concatenate([actual, desired]), axis=0)
    ratios = [float(np.clip(spans[across] / max(spans[up], 1e-12), 0.5, 2.0)) for across, up in views]
    figure = Figure(figsize=(min(WIDTH, max(3.4, 3.0 * sum(ratios) + 0.8 * len(views))), 3.6), layout="compressed")
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=ratios)[0]
    for axes, (across, up) in zip(panels, views, strict=True):
        _draw(axes, actual[:, [across, up]], desired[:, [across, up]])
        axes.set_xlabel(f"${'xyz'[across]}$  [m]")
        axes.set_ylabel(f"${'xyz'[up]}$  [m]")
        if rises:
            axes.set_title("from above" if up == 1 else "from the side")
    mark: dict[str, Any] = {"color": "0.2", "linestyle": "none", "markerfacecolor": "white", "markersize": 5.0}
    legend_above(
        figure,
        [
            Line2D([], [], **LINES[1], label="desired"),
            Line2D([], [], **LINES[0], label="actual"),
            *(Line2D([], [], **mark, marker=shape, label=name) for name, shape in MARKS.items()),
        ],
    )
    return figure


def _draw(axes: Axes, actual: np.ndarray, desired: np.ndarray) -> None:
    axes.plot(*actual.T, **{**LINES[0], "linewidth": 1.5})
    axes.plot(*desired.T, **{**LINES[1], "linewidth": 1.1})
    for path, line in ((actual, LINES[0]), (desired, LINES[1])):
        for place, shape in zip((path[0], path[-1]), MARKS.values(), strict=True):
            mark: dict[str, Any] = {"markersize": 5.0, "markerfacecolor": "white", "markeredgecolor": line["color"]}
            axes.plot(*place, marker=shape, linestyle="none", **mark, zorder=4)
    axes.set_aspect("equal", adjustable="box")
    axes.margins(0.08)
