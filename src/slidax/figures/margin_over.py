"""The margin of many runs over uncertain parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import LIMIT, WIDTH, legend_above, styled

MOST = 1500
"""Points in a panel."""


@styled
def margin_over(margin: np.ndarray, values: Mapping[str, np.ndarray], names: str = "margin") -> Figure:
    """One panel per uncertain parameter: the margin of each run over its value; failed runs are marked.

    With many runs every k-th is drawn, and all with the least margin.

    - `margin`: of each run; < 0 if it failed.
    - `values`: of each run by axis label.
    - `names`: label of the margin.
    """
    known = np.isfinite(margin)
    order = np.flatnonzero(known)
    least = order[np.argsort(margin[order], kind="stable")[: MOST // 3]]
    chosen = np.union1d(order[:: max(len(order) // MOST, 1)], least)
    failed = margin[chosen] < 0
    rows = -(-max(len(values), 1) // 3)
    figure = Figure(figsize=(WIDTH, 1.85 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, 3, squeeze=False, sharey=True)
    for axes, (label, numbers) in zip(panels.ravel(), values.items(), strict=False):
        x = np.asarray(numbers, float)[chosen]
        axes.plot(x[~failed], margin[chosen][~failed], ".", color="#0072B2", markersize=2.2, alpha=0.5, rasterized=True)
        axes.plot(x[failed], margin[chosen][failed], "x", color="#A33B20", markersize=4.0, rasterized=True)
        if failed.any():
            axes.axhline(0.0, **LIMIT)
        # A logarithmic axis where values are spread so, and not where some are near zero by chance.
        if len(x) and x.min() > 0 and x.max() > 30 * x.min() and np.median(x) < 0.25 * x.max():
            axes.set_xscale("log")
        axes.margins(x=0.03)
        axes.set_xlabel(label)
    for row in panels:
        row[0].set_ylabel(names)
    for axes in panels.ravel()[len(values) :]:
        axes.set_visible(False)
    looks = [("o", "#0072B2", "held"), ("x", "#A33B20", "failed")]
    legend_above(
        figure,
        [
            Line2D([], [], linestyle="none", marker=mark, color=color, markersize=3.5, label=label)
            for mark, color, label in looks
            if label == "held" or failed.any()
        ],
    )
    return figure
