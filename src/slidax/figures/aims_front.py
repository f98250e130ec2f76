"""The Pareto front of several objectives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import LINES, WIDTH, legend_above, styled


@styled
def aims_front(labels: Sequence[str], front: np.ndarray, today: np.ndarray, best: int | None = None) -> Figure:
    """The first objective against each other one: candidates of a front, the best of them, and the current parameters.

    - `labels`: of the objectives, with units.
    - `front`: [candidates objectives].
    - `today`: objectives of the current parameters [objectives].
    - `best`: index of the marked candidate; None for none.
    """
    others = range(1, len(labels)) if len(labels) > 1 else range(1)
    figure = Figure(figsize=(min(WIDTH, 3.4 * len(others) + 0.4), 2.9), layout="constrained")
    panels = figure.subplots(1, len(others), squeeze=False)[0]
    looks = {"candidates": ("o", LINES[0]["color"], "white"), "today": ("s", "#A33B20", "#A33B20")}
    if best is not None:
        looks["best"] = ("o", LINES[0]["color"], LINES[0]["color"])
    for panel, other in zip(panels, others, strict=True):
        for name, points in (
            ("candidates", front),
            ("today", today[None]),
            ("best", front[best : best + 1] if best is not None else front[:0]),
        ):
            if name in looks:
                mark, edge, face = looks[name]
                style = {"marker": mark, "markeredgecolor": edge, "markerfacecolor": face, "markersize": 5.0}
                panel.plot(points[:, 0], points[:, other], linestyle="none", **style)
        numbers = np.concatenate([front, today[None]])
        for column, scale in ((0, panel.set_xscale), (other, panel.set_yscale)):
            known = numbers[np.isfinite(numbers[:, column]), column]
            if known.size and known.min() > 0 and known.max() > 3 * known.min():
                scale("log")
        panel.set_xlabel(labels[0])
        panel.set_ylabel(labels[other])
        panel.margins(0.08)
    handles = [
        Line2D([], [], linestyle="none", marker=mark, markeredgecolor=edge, markerfacecolor=face, label=name)
        for name, (mark, edge, face) in looks.items()
    ]
    legend_above(figure, handles)
    return figure
