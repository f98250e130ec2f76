"""Shares with their intervals, and errors beside them, a line for each scheme."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from slidax._errors import DefinitionError

from .style import LINES, WIDTH, styled


class Line(NamedTuple):
    """A scheme.

    - `name`: of it.
    - `share`, `lower`, `upper`: with its interval, of 1.
    - `error`: > 0; None where there is none.
    - `leads`: whether it is filled.
    """

    name: str
    share: float
    lower: float
    upper: float
    error: float | None
    leads: bool


@styled
def benchmark_table(lines: Sequence[Line], share: str, error: str) -> Figure:
    """A dot with its interval for each share, and on a logarithmic axis one for each error.

    - `lines`: from the top down.
    - `share`, `error`: labels of the axes.

    Raises DefinitionError if there is nothing to draw.
    """
    if not lines:
        raise DefinitionError("there is nothing to draw: give at least one line")
    figure = Figure(figsize=(WIDTH, 0.7 + 0.17 * len(lines)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    color = LINES[0]["color"]
    for place, line in enumerate(lines):
        filled = color if line.leads else "white"
        dot = {"marker": "o", "markersize": 4, "color": color, "markerfacecolor": filled, "linestyle": "none"}
        left.plot([100 * line.lower, 100 * line.upper], [place, place], color=color, linewidth=0.9)
        left.plot([100 * line.share], [place], **dot)
        if line.error is not None and np.isfinite(line.error) and line.error > 0:
            right.plot([line.error], [place], **dot)
        else:
            right.annotate("–", (0.02, place), xycoords=("axes fraction", "data"), va="center", color=color)
    left.set_yticks(range(len(lines)), [line.name for line in lines])
    left.set_ylim(len(lines) - 0.4, -0.6)
    left.set_xlim(-2, 102)
    left.set_xlabel(share)
    if any(line.error for line in lines):
        right.set_xscale("log")
        right.margins(x=0.05)
        right.autoscale_view()
    right.set_xlabel(error)
    for axes in (left, right):
        axes.grid(True, axis="x")
        axes.tick_params(axis="y", length=0)
    return figure
