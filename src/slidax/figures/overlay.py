"""Line styles, axis ranges and number of points for figures of several runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax._errors import DefinitionError
from slidax.simulation import Run

from .logged import log_of
from .style import LINES, legend_above
from .thinning import column_starts

LOOKS: tuple[dict[str, Any], ...] = (
    *LINES[:4],
    {"color": "#C79100", "linestyle": (0, (8, 1.6))},
    {"color": "#000000", "linestyle": (0, (3, 1.2, 1.2, 1.2, 1.2, 1.2))},
    {"color": "#CC5F9B", "linestyle": (0, (2.4, 1.2))},
    {"color": "#56B4E9", "linestyle": (0, (8, 1.4, 2.4, 1.4))},
    {"color": "#7A5230", "linestyle": (0, (1.2, 2.2))},
    {"color": "#6B7785", "linestyle": "-"},
    {"color": "#A50F15", "linestyle": (0, (5, 1.2, 1.2, 1.2, 1.2, 1.2))},
    {"color": "#00594C", "linestyle": (0, (3, 2.4))},
    {"color": "#8C8C00", "linestyle": (0, (6, 1.2, 1.2, 1.2))},
)
"""Colour and dashes of each run: enough for all schemes, distinct without colour too."""

POINTS = 4800
"""Points of all curves in a figure together at most, approximately."""


SPAN = 6.0
"""Range of an axis relative to the usual value of the median run; higher peaks are cut off."""


@dataclass(frozen=True)
class Trace:
    """One run as it is drawn.

    - `t`: time [k], s.
    - `y`: values [k n], all finite.
    - `look`: colour and dashes.
    """

    t: np.ndarray
    y: np.ndarray
    look: dict[str, Any]


def traces_of(runs: Mapping[str, Run], field: str) -> list[Trace]:
    """The finite samples of each run.

    - `runs`: of the same arm, with logs, by name.
    - `field`: quantity of the log: `e`, `de` or `tau`.

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    require_looks(runs)
    first = next(iter(runs.values()))
    traces = []
    for (name, run), look in zip(runs.items(), LOOKS, strict=False):
        if run.joint_names != first.joint_names or run.joint_units != first.joint_units:
            raise DefinitionError(f"the run `{name}` is of an arm with other joints; runs of one arm can be compared")
        log = log_of(run)
        y = np.asarray(getattr(log, field))
        finite = np.isfinite(y).all(axis=1)
        if finite.sum() < 2:
            raise DefinitionError(f"the run `{name}` has fewer than two finite samples; leave it out")
        traces.append(Trace(np.asarray(log.t)[finite], y[finite], look))
    return traces


def require_looks(named: Mapping[str, Any]) -> None:
    """Raise DefinitionError unless there is at least one entry in `named`, and a line style for each."""
    if not 1 <= len(named) <= len(LOOKS):
        raise DefinitionError(f"this figure shows 1 to {len(LOOKS)} runs; got {len(named)}")


def columns_for(curves: int, points: int) -> int:
    """Columns of a panel for a number of `curves` in the figure, with `points` per column."""
    return int(np.clip(POINTS // (curves * points), 30, 160))


def linear_range(values: Sequence[np.ndarray], span: float = SPAN) -> tuple[float, float]:
    """The range of a linear axis: all values, unless a few peaks would flatten the rest.

    - `values`: of each curve [k].
    - `span`: range relative to the usual value of the median run; infinite shows all.
    """
    inner = np.array([np.quantile(value, (0.01, 0.99)) for value in values if len(value)] or [(-1.0, 1.0)])
    whole = np.array([(value.min(), value.max()) for value in values if len(value)] or [(-1.0, 1.0)])
    usual = span * float(np.median(np.abs(inner).max(axis=1)))
    low, high = float(whole[:, 0].min()), float(whole[:, 1].max())
    if 0 < usual < np.inf:
        low, high = max(low, -usual), min(high, usual)
    low, high = min(low, 0.0), max(high, 0.0)
    gap = 0.07 * ((high - low) or 1.0)
    return low - gap, high + gap


def clipped(y: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """The values `y`, clipped one span outside the axis `limits`, where drawing does not overflow."""
    span = limits[1] - limits[0]
    return np.clip(y, limits[0] - span, limits[1] + span)


def crest(t: np.ndarray, size: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """The largest sample of each column, from the first time to the last.

    Errors that oscillate about zero become lines at their amplitude, which can be distinguished.

    - `t`: increasing [k].
    - `size`: values >= 0 [k].
    - `columns`: number of columns.
    """
    if len(t) <= columns:
        return t, size
    starts = column_starts(t, columns)
    ends = np.append(starts[1:], len(t))
    peaks = [start + int(np.argmax(size[start:end])) for start, end in zip(starts, ends, strict=True)]
    x, y = np.append(t[peaks], t[-1]), np.append(size[peaks], size[peaks[-1]])
    # An error that starts at zero comes from below any logarithmic axis; its line starts where it has a size.
    return (np.append(t[0], x), np.append(size[0], y)) if size[0] > 1e-3 * y[0] else (x, y)


def zero_line(axes: Axes) -> None:
    """Draw a faint line at zero on `axes`."""
    axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)


def name_runs(figure: Figure, names: Iterable[str], more: Sequence[Any] = ()) -> None:
    """Add a legend to a `figure` with the `names` in the order of `LOOKS`, and `more` handles."""
    handles = [Line2D([], [], **look, label=name) for name, look in zip(names, LOOKS, strict=False)]
    handles += more
    legend_above(figure, handles, columns=-(-len(handles) // legend_rows(len(handles), figure.get_figwidth())))


def legend_rows(entries: int, width: float) -> int:
    """Number of rows of a legend with `entries` in a figure of a `width` [in]."""
    return -(-entries // max(1, int(width / 1.35)))
