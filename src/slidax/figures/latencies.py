"""Latencies of a real-time loop."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from .style import LIMIT, WIDTH, styled

BINS = 120
LEAST = 0.2
"""Smaller times are counted here [µs]."""


@styled
def latencies(times: Mapping[str, np.ndarray], period: float) -> Figure:
    """Number of ticks by latency, on logarithmic axes that show rare delays.

    - `times`: of all ticks by name, s.
    - `period`: sample time, drawn as a line [s].
    """
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    axes = figure.subplots()
    longest = max([1e6 * period, *(1e6 * float(values.max()) for values in times.values() if len(values))])
    edges = np.geomspace(LEAST, 1.5 * longest, BINS + 1)
    for name, values in times.items():
        counts, _ = np.histogram(np.maximum(1e6 * values, LEAST), edges)
        axes.stairs(np.where(counts > 0, counts, np.nan), edges, label=name, linewidth=0.9)
    axes.axvline(1e6 * period, **LIMIT)
    axes.annotate("period", (1e6 * period, 1.0), xycoords=("data", "axes fraction"), ha="right", va="top", rotation=90)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("time [µs]")
    axes.set_ylabel("ticks")
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
