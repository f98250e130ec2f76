"""Progress of a search."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from .style import LIMIT, LINES, styled


@styled
def search_history(history: np.ndarray, label: str, bound: float | None = None) -> Figure:
    """The lowest value so far, over the number of runs.

    - `history`: number of runs and lowest value [looks 2].
    - `label`: of the values, with the unit.
    - `bound`: a level to mark; None for none.
    """
    figure = Figure(figsize=(4.6, 2.1), layout="constrained")
    axes = figure.subplots()
    runs, lowest = np.asarray(history, float).reshape(-1, 2).T
    known = np.isfinite(lowest)
    axes.step(runs[known], lowest[known], where="post", **LINES[0])
    if bound is not None:
        axes.axhline(bound, **LIMIT)
    axes.set_xlabel("runs")
    axes.set_ylabel(label)
    axes.margins(y=0.08)
    return figure
