"""Figures of many runs: distributions, parameter maps, searches, rankings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, ScalarFormatter

from slidax.core.errors import DefinitionError

from .style import BOUND, LIMIT, LINES, SMALL, WIDTH, legend_above, styled, use_plain_ticks


@styled
def pareto_front(labels: Sequence[str], front: np.ndarray, today: np.ndarray, best: int | None = None) -> Figure:
    """Candidates of a Pareto front and the current parameters, as the first objective against each other objective.

    - `labels`: labels of the objectives, with units.
    - `front`: objectives of the candidates [candidates objectives].
    - `today`: objectives of the current parameters [objectives].
    - `best`: index of the candidate to mark; None to mark none.
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
        for column, scale, axis in ((0, panel.set_xscale, panel.xaxis), (other, panel.set_yscale, panel.yaxis)):
            known = numbers[np.isfinite(numbers[:, column]), column]
            if known.size and known.min() > 0 and known.max() > 3 * known.min():
                scale("log")
                use_plain_ticks(axis, known.min(), known.max())
        panel.set_xlabel(labels[0])
        panel.set_ylabel(labels[other])
        panel.margins(0.08)
    handles = [
        Line2D([], [], linestyle="none", marker=mark, markeredgecolor=edge, markerfacecolor=face, label=name)
        for name, (mark, edge, face) in looks.items()
    ]
    legend_above(figure, handles)
    return figure


FEW, MANY = 1000, 60
"""From `FEW` runs on, the counts have a logarithmic axis, and a panel up to `MANY` bars; with fewer runs, a third."""


def _bins(numbers: np.ndarray) -> int:
    """Return the number of bars by Freedman and Diaconis (1981), at least 5 and at most the limit for so many runs."""
    most = MANY if len(numbers) >= FEW else MANY // 3
    lower, upper = np.quantile(numbers, [0.25, 0.75])
    width = 2.0 * (upper - lower) / np.cbrt(len(numbers))
    return int(np.clip(np.ptp(numbers) / width, 5, most)) if width > 0.0 else most


def _few_ticks(axis: Axis) -> None:
    """Set at most five ticks on a linear axis, with a common power of ten, to fit a small panel."""
    axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    formatter = ScalarFormatter(useMathText=True)
    formatter.set_powerlimits((-2, 4))
    axis.set_major_formatter(formatter)


@styled
def histograms(values: Mapping[str, np.ndarray], limits: Mapping[str, float] = {}) -> Figure:
    """Histograms of the runs, one panel per quantity.

    An axis is logarithmic if all values are > 0 and the largest is more than 30 times the least.

    - `values`: values of all runs by axis label. Non-finite values, and quantities with equal values, are omitted.
    - `limits`: positions of vertical lines, by axis label.
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
            axes.xaxis.set_major_locator(LogLocator(numticks=5))
            edges = np.geomspace(low, high, _bins(np.log(numbers)) + 1)
        else:
            spare = 0.02 * (high - low) or 0.5 * (abs(high) or 1.0)
            edges = np.linspace(low - spare, high + spare, _bins(numbers) + 1)
            _few_ticks(axes.xaxis)
        counts, _ = np.histogram(numbers, edges)
        axes.stairs(counts, edges, fill=True, facecolor="#C9D8E8", edgecolor="#0072B2", linewidth=0.6)
        if len(numbers) >= FEW:
            # A single run of a hundred thousand stays visible.
            axes.set_yscale("symlog", linthresh=1.0)
            axes.set_ylim(0, 3.0 * int(counts.max()))
        else:
            axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.set_ylim(0, 1.08 * int(counts.max()))
        axes.set_xlabel(label)
        axes.set_ylabel("runs")
        if label in limits:
            axes.axvline(limits[label], **LIMIT)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return figure


@styled
def intervals(names: Sequence[str], values: Mapping[str, np.ndarray]) -> Figure:
    """One panel per quantity: a row with a mark and an interval for each name, such as a scheme, and a line at 0.

    - `names`: names of the rows, from top to bottom.
    - `values`: lower end, value and upper end of each row [names 3], by panel label; NaN for a missing value.
    """
    figure = Figure(figsize=(WIDTH, 0.26 * len(names) + 0.85), layout="constrained")
    panels = figure.subplots(1, max(len(values), 1), squeeze=False, sharey=True)[0]
    rows = np.arange(len(names))[::-1]
    for panel, (label, numbers) in zip(panels, values.items(), strict=False):
        low, middle, high = np.asarray(numbers, float).T
        reach = np.nan_to_num(np.array([middle - low, high - middle]))
        panel.errorbar(
            middle, rows, xerr=np.maximum(reach, 0.0), fmt="o", color=LINES[0]["color"], markersize=3.5, linewidth=1.0
        )
        panel.axvline(0.0, **BOUND)
        panel.set_xlabel(label)
        panel.margins(x=0.08, y=0.3)
        panel.grid(False, axis="y")
    panels[0].set_yticks(rows, list(names))
    return figure


MOST = 1500
"""Every k-th of n runs is drawn, k = n // `MOST`, so that fewer than 2 `MOST` of these points are in a panel."""

RASTERED = 200
"""Largest number of points that are drawn as vectors."""

HELD: dict[str, Any] = {"marker": "o", "color": "#0072B2", "markersize": 1.6, "markeredgewidth": 0.0}
FAILED: dict[str, Any] = {"marker": "x", "color": "#A33B20", "markersize": 4.0}
"""Marks of runs that did not fail, and of failed runs."""


@styled
def margin_over(margin: np.ndarray, values: Mapping[str, np.ndarray], names: str = "margin") -> Figure:
    """Margin of each run over the value of an uncertain parameter, one panel per parameter. Failed runs are marked.

    From many runs every k-th is drawn, and in addition the 500 with the least margin.

    - `margin`: margin of each run; < 0 if the run failed.
    - `values`: the parameter's value in each run, by axis label.
    - `names`: label of the margin axis.
    """
    known = np.isfinite(margin)
    order = np.flatnonzero(known)
    least = order[np.argsort(margin[order], kind="stable")[: MOST // 3]]
    chosen = np.union1d(order[:: max(len(order) // MOST, 1)], least)
    failed = margin[chosen] < 0
    rows = -(-max(len(values), 1) // 3)
    figure = Figure(figsize=(WIDTH, 1.85 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, 3, squeeze=False, sharey=True)
    for axes, (label, numbers) in zip(panels.ravel(), values.items(), strict=False):
        x = np.asarray(numbers, float)[chosen]
        # Many points are a raster image, which keeps its colours on a dark page; vectors change theirs.
        for marked, look in ((~failed, HELD), (failed, FAILED)):
            axes.plot(x[marked], margin[chosen][marked], **look, linestyle="none", rasterized=len(x) > RASTERED)
        if failed.any():
            axes.axhline(0.0, **LIMIT)
        # The axis is logarithmic if the values are spread over decades, and not if only a few are near zero.
        if len(x) and x.min() > 0 and x.max() > 30 * x.min() and np.median(x) < 0.25 * x.max():
            axes.set_xscale("log")
        else:
            _few_ticks(axes.xaxis)
        axes.margins(x=0.03)
        axes.set_xlabel(label)
    for row in panels:
        row[0].set_ylabel(names)
    for axes in panels.ravel()[len(values) :]:
        axes.set_visible(False)
    looks = {"held": HELD} | ({"failed": FAILED} if failed.any() else {})
    handles = [
        Line2D([], [], linestyle="none", **look | {"markersize": 3.5}, label=name) for name, look in looks.items()
    ]
    legend_above(figure, handles)
    return figure


@styled
def parameter_map(axes: Mapping[str, np.ndarray], values: np.ndarray, label: str, bound: float | None = None) -> Figure:
    """A line over one parameter, or a map over two, with the contour at a bound.

    - `axes`: values of one or two parameters, by label.
    - `values`: the result for each combination of the parameters' values [x] or [x y]; non-finite results are omitted.
    - `label`: label of the result, with the unit.
    - `bound`: result that separates good from bad; None for no line.
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
        figure = Figure(figsize=(SMALL, 3.4), layout="constrained")
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
            use_plain_ticks(axis, float(numbers[0]), float(numbers[-1]))


@styled
def search_history(history: np.ndarray, label: str, bound: float | None = None) -> Figure:
    """The worst value that a search has found so far, over the number of runs.

    - `history`: number of runs, and worst value so far, after each batch [batches 2].
    - `label`: label of the values, with the unit.
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


@styled
def variance_shares(
    names: Sequence[str], first: np.ndarray, total: np.ndarray, halves: tuple[np.ndarray, np.ndarray]
) -> Figure:
    """Two bars for each parameter: its first-order and its total Sobol index.

    - `names`: names from top to bottom.
    - `first`, `total`: Sobol indices [parameters].
    - `halves`: half the widths of their confidence intervals [parameters].
    """
    figure = Figure(figsize=(5.4, 0.42 * len(names) + 0.9), layout="constrained")
    axes = figure.subplots()
    rows = np.arange(len(names))[::-1]
    looks = (
        (0.18, first, halves[0], LINES[0]["color"], "alone"),
        (-0.18, total, halves[1], "white", "with interactions"),
    )
    handles = []
    for shift, values, half, color, label in looks:
        skin = {"facecolor": color, "edgecolor": LINES[0]["color"], "linewidth": 0.8}
        width = np.clip(values, 0.0, None)
        axes.barh(rows + shift, width, 0.32, xerr=half, error_kw={"linewidth": 0.7, "ecolor": "0.35"}, **skin)
        handles.append(Patch(**skin, label=label))
    axes.set_yticks(rows, list(names))
    axes.set_xlim(0.0, max(1.0, float(np.max(np.maximum(first, total) + np.maximum(*halves), initial=0.0))))
    axes.set_xlabel("share of the variance")
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    legend_above(figure, handles)
    return figure


class RankingLine(NamedTuple):
    """A scheme's row in the figure of a benchmark task.

    - `share`, `lower`, `upper`: share of cases inside the tolerance band, with its interval, in [0, 1].
    - `error`: median steady error, > 0; None without a value.
    - `leads`: True to fill its dot.
    """

    name: str
    share: float
    lower: float
    upper: float
    error: float | None
    leads: bool


@styled
def benchmark_table(lines: Sequence[RankingLine], share: str, error: str) -> Figure:
    """A row for each scheme: to the left its share with an interval, to the right its error on a logarithmic axis.

    - `lines`: the rows, from top to bottom.
    - `share`, `error`: labels of the axes.

    Raises DefinitionError if there are no rows.
    """
    if not lines:
        raise DefinitionError("`lines` is empty: give at least one scheme")
    figure = Figure(figsize=(WIDTH, 0.7 + 0.17 * len(lines)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    color = LINES[0]["color"]
    for row, line in enumerate(lines):
        filled = color if line.leads else "white"
        dot = {"marker": "o", "markersize": 4, "color": color, "markerfacecolor": filled, "linestyle": "none"}
        left.plot([100 * line.lower, 100 * line.upper], [row, row], color=color, linewidth=0.9)
        left.plot([100 * line.share], [row], **dot)
        if line.error is not None and np.isfinite(line.error) and line.error > 0:
            right.plot([line.error], [row], **dot)
        else:
            right.annotate("–", (0.02, row), xycoords=("axes fraction", "data"), va="center", color=color)
    left.set_yticks(range(len(lines)), [line.name for line in lines])
    left.set_ylim(len(lines) - 0.4, -0.6)
    left.set_xlim(-2, 102)
    left.set_xlabel(share)
    if any(line.error for line in lines):
        right.set_xscale("log")
        right.margins(x=0.05)
        right.autoscale_view()
        use_plain_ticks(right.xaxis, *right.get_xlim())
    right.set_xlabel(error)
    for axes in (left, right):
        axes.grid(True, axis="x")
        axes.tick_params(axis="y", length=0)
    return figure
