"""Distributions over many runs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from .style import LIMIT, WIDTH, styled

BINS = 60


@styled
def histograms(values: Mapping[str, np.ndarray], limits: Mapping[str, float] = {}) -> Figure:
    """One panel per quantity: number of runs over its value, logarithmic if all values are > 0 and span decades.

    - `values`: of all runs by axis label; non-finite values are omitted.
    - `limits`: positions of lines, by the same labels.
    """
    shown = {label: np.asarray(numbers)[np.isfinite(numbers)] for label, numbers in values.items()}
    # Omit values that are equal in all runs.
    shown = {
        label: numbers
        for label, numbers in shown.items()
        if len(numbers) and np.ptp(numbers) > 1e-9 * np.abs(numbers).max()
    }
    figure = Figure(figsize=(WIDTH, 1.9 * max(-(-len(shown) // 2), 1)), layout="constrained")
    panels = figure.subplots(-(-max(len(shown), 1) // 2), 2, squeeze=False).ravel()
    for axes, (label, numbers) in zip(panels, shown.items(), strict=False):
        low, high = float(numbers.min()), float(numbers.max())
        if low > 0 and high > 30 * low:
            axes.set_xscale("log")
            edges = np.geomspace(low, high, BINS + 1)
        else:
            spare = 0.02 * (high - low) or 0.5 * (abs(high) or 1.0)
            edges = np.linspace(low - spare, high + spare, BINS + 1)
        counts, _ = np.histogram(numbers, edges)
        axes.stairs(counts, edges, fill=True, facecolor="#C9D8E8", edgecolor="#0072B2", linewidth=0.6)
        # So that one run in a hundred thousand is seen.
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(0, 3.0 * max(int(counts.max()), 1))
        axes.set_xlabel(label)
        axes.set_ylabel("runs")
        if label in limits:
            axes.axvline(limits[label], **LIMIT)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return figure
