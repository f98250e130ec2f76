"""Axes for time, and for sizes on a logarithmic scale."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter


def use_time_axis(axes: Axes, start: float, end: float) -> None:
    """Label time from `start` to `end` [s] on `axes`, with a gap before the start for steep beginnings."""
    axes.set_xlabel(r"$t$  [s]")
    axes.set_xlim(start - 0.012 * (end - start), end)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))


def use_size_axis(panels: Iterable[Axes], sizes: np.ndarray) -> None:
    """Use one logarithmic axis in whole decades for all `panels`, which shows nearly all `sizes` (>= 0).

    The size of an error that crosses zero vanishes for a moment; the axis ends above the deepest such values.
    """
    positive = sizes[np.isfinite(sizes) & (sizes > 0)]
    if not len(positive):
        positive = np.array([1e-3, 1.0])
    high = int(np.ceil(np.log10(positive.max()) + 0.02))
    low = min(int(np.floor(np.log10(np.quantile(positive, 0.02)))), high - 2)
    for axes in panels:
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(10.0**low, 10.0**high)
        axes.yaxis.set_major_locator(LogLocator(base=10.0 ** max(1, round((high - low) / 5)), numticks=12))
        axes.yaxis.set_minor_locator(LogLocator(base=10.0, numticks=40))
        axes.yaxis.set_minor_formatter(NullFormatter())
