"""Torque limits in a figure."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from .style import LIMIT

NEAR = 0.4
"""The limit is inside the axes if a torque exceeds this share of it."""


def draw_limit(panels: Iterable[Axes], limit: float, unit: str) -> None:
    """Draw a line at each torque limit, and its value above the first panel.

    Far above the torque, the lines lie outside the axes, so that the torque stays visible.

    - `panels`: of one joint, with the torques drawn.
    - `limit`: largest torque [N m or N]; nothing is drawn if it is infinite.
    - `unit`: of the torque.
    """
    if not np.isfinite(limit):
        return
    panels = list(panels)
    for axes in panels:
        low, high = axes.get_ylim()
        gap = 0.07 * limit
        for end in (-limit, limit):
            axes.axhline(end, **LIMIT, zorder=1.7)
        if high > NEAR * limit:
            high = max(high, limit + gap)
        if -low > NEAR * limit:
            low = min(low, -limit - gap)
        axes.set_ylim(low, high)
    panels[0].set_title(f"limit ±{limit:g} {unit}", loc="right", fontsize=7.5, color=LIMIT["color"], pad=2.5)


def limit_handle() -> Line2D:
    """The legend entry of the limits."""
    return Line2D([], [], **LIMIT, label="torque limit")
