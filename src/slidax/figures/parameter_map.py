"""A result over one or two parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from .style import LIMIT, LINES, styled


@styled
def parameter_map(axes: Mapping[str, np.ndarray], values: np.ndarray, label: str, bound: float | None = None) -> Figure:
    """A line over one parameter, or a map over two, with the contour at a bound.

    - `axes`: values of one or two parameters, by label.
    - `values`: the result at each combination; non-finite values are omitted.
    - `label`: of the result, with the unit.
    - `bound`: between good and bad; None for none.
    """
    (first, x), *rest = axes.items()
    shown = np.ma.masked_invalid(np.asarray(values, float))
    if not rest:
        figure = Figure(figsize=(4.6, 2.6), layout="constrained")
        panel = figure.subplots()
        panel.plot(x, shown, marker=".", markersize=4.0, **LINES[0])
        if bound is not None:
            panel.axhline(bound, **LIMIT)
        panel.set_ylabel(label)
        panel.margins(y=0.08)
    else:
        ((second, y),) = rest
        figure = Figure(figsize=(4.9, 3.4), layout="constrained")
        panel = figure.subplots()
        mesh = panel.pcolormesh(x, y, shown.T, shading="nearest", cmap="cividis", rasterized=True)
        if bound is not None and shown.count() and shown.min() < bound < shown.max() and min(shown.shape) > 1:
            panel.contour(x, y, shown.T, levels=[bound], colors=LIMIT["color"], linewidths=1.2)
        figure.colorbar(mesh, ax=panel, label=label)
        panel.set_ylabel(second)
        _logarithmic(y, panel.set_yscale, panel.yaxis)
        panel.grid(False)
    panel.set_xlabel(first)
    _logarithmic(x, panel.set_xscale, panel.xaxis)
    return figure


def _logarithmic(numbers: np.ndarray, set_scale: Callable[[str], Any], axis: Axis) -> None:
    """Use a logarithmic axis if the steps are ratios rather than differences."""
    if len(numbers) > 2 and np.min(numbers) > 0 and np.max(numbers) > 5 * np.min(numbers):
        ratios, steps = np.diff(np.log(numbers)), np.diff(numbers)
        if np.ptp(ratios) / abs(ratios.mean()) < np.ptp(steps) / abs(steps.mean()):
            set_scale("log")
            if numbers[-1] < 1e3 * numbers[0]:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.set_major_formatter(StrMethodFormatter("{x:g}"))
                axis.set_minor_formatter(NullFormatter())
