"""One metric of several schemes, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from slidax._errors import DefinitionError

from .overlay import LOOKS, legend_rows, require_looks
from .style import WIDTH, legend_above, styled

HATCHES = ("", "////", "----", "xxxx", "\\\\\\\\", "||||", "++++", "//", "--", "\\\\", "xx", "||", "-|")
"""Hatches of the first, second, ... scheme, distinct without colour; lines only, since dots make large SVGs."""


@styled
def metric_bars(
    values: Mapping[str, Sequence[float | None]], label: str, joints: Sequence[str] | None = None
) -> Figure:
    """One group of bars per joint, with one bar per scheme, on a logarithmic axis.

    A value that is zero, not finite or missing is a dash.

    - `values`: by scheme, one value per joint, >= 0.
    - `label`: of the axis, with the unit.
    - `joints`: names; by default numbers.

    Raises DefinitionError if there are no schemes, too many, or they have different numbers of joints.
    """
    require_looks(values)
    if len({len(row) for row in values.values()}) != 1:
        raise DefinitionError("each scheme needs one value per joint, and all of them the same joints")
    table = np.array([list(row) for row in values.values()], dtype=float)
    drawn = np.where(np.isfinite(table) & (table > 0), table, np.nan)
    across = min(WIDTH, 5.5 + 0.06 * table.size)
    rows = legend_rows(len(table), across)
    figure = Figure(figsize=(across, 2.5 + 0.2 * rows), layout="constrained")
    axes = figure.subplots()
    width = 0.8 / len(table)
    low, high = _decades(drawn)
    handles = []
    for i, (name, row) in enumerate(zip(values, drawn, strict=True)):
        color = LOOKS[i]["color"]
        skin = {"facecolor": color if i == 0 else "white", "edgecolor": color, "hatch": HATCHES[i], "linewidth": 0.8}
        places = np.arange(table.shape[1]) + (i - 0.5 * (len(table) - 1)) * width
        there = np.isfinite(row)
        axes.bar(places[there], row[there] - low, 0.86 * width, bottom=low, **skin)
        for place in places[~there]:
            axes.annotate("–", (place, low), xytext=(0, 3), textcoords="offset points", ha="center", color=color)
        handles.append(Patch(**skin, label=name))
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    axes.set_ylabel(label)
    axes.set_xticks(range(table.shape[1]), joints or [f"joint {i + 1}" for i in range(table.shape[1])])
    axes.set_xlim(-0.55, table.shape[1] - 0.45)
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    legend_above(figure, handles, columns=-(-len(table) // rows))
    return figure


def _decades(drawn: np.ndarray) -> tuple[float, float]:
    """From a decade below the least value, so that its bar has a height, to above the largest."""
    if not np.isfinite(drawn).any():
        return 0.1, 10.0
    low, high = np.log10(np.nanmin(drawn)), np.log10(np.nanmax(drawn))
    return float(10.0 ** np.floor(low - 0.35)), float(10.0 ** (high + 0.12 * max(1.0, high - np.floor(low - 0.35))))
