"""Tip paths of several schemes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .overlay import LOOKS, POINTS, legend_rows, name_runs, require_looks
from .style import WIDTH, styled
from .thinning import every_nth

DESIRED: dict[str, Any] = {"color": "0.7", "linewidth": 3.2, "linestyle": "-", "solid_capstyle": "butt"}


@styled
def compared_tip_paths(paths: Mapping[str, np.ndarray], desired: np.ndarray) -> Figure:
    """The tip's path under each scheme over the desired one, from above, and from the side if the desired one rises.

    Each path starts at a ring. Paths that stray by more than the size of the desired path are cut off.

    - `paths`: tip positions [k 3], m, by name.
    - `desired`: desired tip positions [k 3], m.

    Raises DefinitionError if there are no paths or too many.
    """
    require_looks(paths)
    goal = np.asarray(desired)
    low, high = _box([np.asarray(path) for path in paths.values()], goal)
    rises = bool(np.ptp(goal[:, 2]) > 1e-9)
    views = [(0, 1), (0, 2)] if rises else [(0, 1)]
    spans = np.maximum(high - low, 1e-9)
    ratios = [float(np.clip(spans[across] / spans[up], 0.5, 2.0)) for across, up in views]
    width = min(WIDTH, max(5.5, 3.0 * sum(ratios) + 0.8 * len(views)))
    figure = Figure(figsize=(width, 3.5 + 0.2 * legend_rows(len(paths) + 1, width)), layout="compressed")
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=ratios)[0]
    for axes, (across, up) in zip(panels, views, strict=True):
        axes.plot(*every_nth(goal[:, [across, up]], 300).T, **DESIRED, zorder=1.8)
        for path, look in zip(paths.values(), LOOKS, strict=False):
            # A straying path is cut one size outside the picture, where the cut is out of sight.
            places = np.clip(np.asarray(path), low - spans.max(), high + spans.max())[:, [across, up]]
            axes.plot(
                *_with_its_beginning(places, POINTS // (3 * len(paths) * len(views))).T, **{**look, "linewidth": 1.0}
            )
            axes.plot(*places[0], marker="o", markersize=4.5, markerfacecolor="white", markeredgecolor="0.2", zorder=4)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlim(low[across], high[across])
        axes.set_ylim(low[up], high[up])
        axes.set_xlabel(f"${'xyz'[across]}$  [m]")
        axes.set_ylabel(f"${'xyz'[up]}$  [m]")
        if rises:
            axes.set_title("from above" if up == 1 else "from the side")
    name_runs(figure, paths, [Line2D([], [], **DESIRED, label="desired")])
    return figure


def _box(paths: list[np.ndarray], goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the figure: all positions no farther out than the desired path is large."""
    reach = np.ptp(goal, axis=0).max() or 1.0
    low, high = goal.min(axis=0), goal.max(axis=0)
    for path in paths:
        low = np.minimum(low, np.maximum(np.nanmin(path, axis=0), goal.min(axis=0) - reach))
        high = np.maximum(high, np.minimum(np.nanmax(path, axis=0), goal.max(axis=0) + reach))
    gap = 0.07 * (high - low).max()
    return low - gap, high + gap


def _with_its_beginning(places: np.ndarray, most: int) -> np.ndarray:
    """Fewer points, half of them evenly along the path and half along time."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    each = min(200, most)
    even = np.searchsorted(way, np.linspace(0.0, way[-1], each)).clip(0, len(places) - 1)
    chosen = np.unique(np.concatenate([even, np.linspace(0, len(places) - 1, each).round().astype(int)]))
    return places[chosen]
