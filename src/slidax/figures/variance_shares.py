"""Sobol indices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .style import LINES, legend_above, styled


@styled
def variance_shares(
    names: Sequence[str], first: np.ndarray, total: np.ndarray, halves: tuple[np.ndarray, np.ndarray]
) -> Figure:
    """Two bars for each parameter: its first-order and its total Sobol index.

    - `names`: from top to bottom.
    - `first`, `total`: Sobol indices [parameters].
    - `halves`: half the widths of their confidence intervals [parameters].
    """
    figure = Figure(figsize=(5.4, 0.42 * len(names) + 0.9), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(names))[::-1]
    looks = ((0.18, first, halves[0], LINES[0]["color"], "by itself"), (-0.18, total, halves[1], "white", "in all"))
    handles = []
    for shift, values, half, color, label in looks:
        skin = {"facecolor": color, "edgecolor": LINES[0]["color"], "linewidth": 0.8}
        width = np.clip(values, 0.0, None)
        axes.barh(places + shift, width, 0.32, xerr=half, error_kw={"linewidth": 0.7, "ecolor": "0.35"}, **skin)
        handles.append(Patch(**skin, label=label))
    axes.set_yticks(places, list(names))
    axes.set_xlim(0.0, max(1.0, float(np.max(np.maximum(first, total) + np.maximum(*halves), initial=0.0))))
    axes.set_xlabel("share of the variance")
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    legend_above(figure, handles)
    return figure
