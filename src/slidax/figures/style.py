"""The common look of all figures: one or two journal columns, small serif type, thin lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .notebook import drawn_by

STYLE: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.edgecolor": "0.25",
    "axes.linewidth": 0.6,
    "axes.labelcolor": "0.1",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.xmargin": 0.0,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "xtick.color": "0.25",
    "ytick.color": "0.25",
    "xtick.labelcolor": "0.1",
    "ytick.labelcolor": "0.1",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "lines.dash_capstyle": "butt",
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "legend.columnspacing": 1.8,
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
    "svg.fonttype": "path",
    "figure.dpi": 100.0,
    "savefig.dpi": 200.0,
}
"""Settings of matplotlib that hold while a figure is drawn. Text becomes paths in an SVG, so that it looks the same
without the typeface.
"""

WIDTH = 6.9
"""Width of a figure over two columns of a journal [in]."""

ROW = 1.45
"""Height of one joint's row [in]."""

LINES: tuple[dict[str, Any], ...] = (
    {"color": "#0072B2", "linestyle": "-"},
    {"color": "#D55E00", "linestyle": (0, (5, 1.6))},
    {"color": "#009E73", "linestyle": (0, (1.2, 1.2))},
    {"color": "#7B3294", "linestyle": (0, (5, 1.4, 1.2, 1.4))},
    {"color": "#000000", "linestyle": (0, (3, 1.2, 1.2, 1.2, 1.2, 1.2))},
)
"""Colour and dashes of the first, second, ... line, distinct without colour too. After Okabe and Ito."""

BAND: dict[str, Any] = {"facecolor": "#E9EEF4", "edgecolor": "none"}
"""The inside of an envelope."""

BOUND: dict[str, Any] = {"color": "#6B7785", "linewidth": 0.8}
"""The edge of an envelope."""

NARROW: dict[str, Any] = {**BOUND, "linewidth": 0.6, "linestyle": (0, (4, 2))}
"""The narrower side of an envelope."""

LIMIT: dict[str, Any] = {"color": "#A33B20", "linewidth": 0.7, "linestyle": (0, (6, 2, 1, 2))}
"""A limit of the drives."""

styled = drawn_by(STYLE)
"""Decorates a function that draws with STYLE; its figure shows itself in a notebook."""


def envelope_patch(label: str = "envelope") -> Patch:
    """The legend entry of an envelope, with a `label`."""
    return Patch(facecolor=BAND["facecolor"], edgecolor=BOUND["color"], linewidth=BOUND["linewidth"], label=label)


def legend_above(figure: Figure, handles: Sequence[Artist], columns: int | None = None) -> None:
    """Add one legend above all panels of a `figure`, in `columns` (default: one row), with `handles`."""
    figure.legend(handles=handles, loc="outside upper center", ncols=columns or len(handles))
