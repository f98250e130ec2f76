"""Values with confidence intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from .style import BOUND, LINES, WIDTH, styled


@styled
def intervals(names: Sequence[str], values: Mapping[str, np.ndarray]) -> Figure:
    """One panel per quantity: a mark and an interval for each name, and a line at 0.

    - `names`: from top to bottom.
    - `values`: by label: lower end, value, upper end [names 3]; NaN where there is none.
    """
    figure = Figure(figsize=(WIDTH, 0.26 * len(names) + 0.85), layout="constrained")
    panels = figure.subplots(1, max(len(values), 1), squeeze=False, sharey=True)[0]
    places = np.arange(len(names))[::-1]
    for panel, (label, numbers) in zip(panels, values.items(), strict=False):
        low, middle, high = np.asarray(numbers, float).T
        reach = np.nan_to_num(np.array([middle - low, high - middle]))
        panel.errorbar(
            middle, places, xerr=np.maximum(reach, 0.0), fmt="o", color=LINES[0]["color"], markersize=3.5, linewidth=1.0
        )
        panel.axvline(0.0, **BOUND)
        panel.set_xlabel(label)
        panel.margins(x=0.08, y=0.3)
        panel.grid(False, axis="y")
    panels[0].set_yticks(places, list(names))
    return figure
