"""The limits of the drives in a panel of torques."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from .style import LIMIT

NEAR = 0.4
"""From this share of its limit on, a torque is shown with the limit in the picture."""


def draw_limit(panels: Iterable[Axes], limit: float, unit: str) -> None:
    """A line at each end of what a drive can do, and its value above the first panel.

    Where the torque stays far below its limit the lines lie outside of the picture, so that the torque can be seen.

    - `panels`: of one joint, with their torques drawn.
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
    """The limit as a legend shows it."""
    return Line2D([], [], **LIMIT, label="torque limit")
