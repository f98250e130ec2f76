"""Figures of several runs of one arm, one line per run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from slidax.core.errors import DefinitionError
from slidax.simulation.run import Run

from .style import (
    BAND,
    BOUND,
    LINES,
    ROW,
    SMALL,
    WIDTH,
    column_starts,
    envelope_patch,
    every_nth,
    joint_label,
    legend_above,
    log_of,
    styled,
    thin_curve,
    use_plain_ticks,
    use_size_axis,
    use_time_axis,
)

LOOKS: tuple[dict[str, Any], ...] = (
    *LINES[:4],
    {"color": "#A67C00", "linestyle": (0, (8, 1.6))},
    {"color": "#000000", "linestyle": (0, (3, 1.2, 1.2, 1.2, 1.2, 1.2))},
    {"color": "#CC5F9B", "linestyle": (0, (2.4, 1.2))},
    {"color": "#3D94CC", "linestyle": (0, (8, 1.4, 2.4, 1.4))},
    {"color": "#7A5230", "linestyle": (0, (1.2, 2.2))},
    {"color": "#6B7785", "linestyle": "-"},
    {"color": "#A50F15", "linestyle": (0, (5, 1.2, 1.2, 1.2, 1.2, 1.2))},
    {"color": "#00594C", "linestyle": (0, (3, 2.4))},
    {"color": "#8C8C00", "linestyle": (0, (6, 1.2, 1.2, 1.2))},
)
"""Colour and dashes of each run: enough for all schemes, distinct without colour too."""

POINTS = 4800
"""Approximate limit of the number of points in a figure, over all curves."""


SPAN = 6.0
"""Limit of a linear axis, as a multiple of the median run's usual value (`linear_range`); higher peaks are cut off."""


@dataclass(frozen=True)
class Trace:
    """The curves of one run.

    - `t`: time [samples], s.
    - `y`: values [samples joints], all finite; of a single joint also [samples].
    - `look`: colour and dashes.
    """

    t: np.ndarray
    y: np.ndarray
    look: dict[str, Any]


def traces_of(runs: Mapping[str, Run], field: str) -> list[Trace]:
    """Return the curves of each run, from its finite samples.

    - `runs`: runs of the same arm, with logs, by name.
    - `field`: quantity of the log: `e`, `de` or `tau`.

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    require_looks(runs)
    first = next(iter(runs.values()))
    traces = []
    for (name, run), look in zip(runs.items(), LOOKS, strict=False):
        if run.joint_names != first.joint_names or run.joint_units != first.joint_units:
            raise DefinitionError(f"the run `{name}` is of an arm with other joints: compare runs of the same arm")
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
    """Return the number of time intervals into which the curves of a figure are thinned.

    - `curves`: number of curves in the figure.
    - `points`: number of points that a thinned curve has in each interval.
    """
    return int(np.clip(POINTS // (curves * points), 30, 160))


def linear_range(values: Sequence[np.ndarray], span: float = SPAN) -> tuple[float, float]:
    """Return the limits of a linear axis that shows 0 and all values, but cuts off a few high peaks.

    The size of a curve is the larger magnitude of its 1 % and 99 % quantiles.

    - `values`: values of each curve [samples].
    - `span`: largest limit, as a multiple of the curves' median size; with infinity, the axis shows all values.
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


def clip_outside(y: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """Clip `y` to the axis `limits`, extended by the axis' length at both ends, so that drawing does not overflow."""
    span = limits[1] - limits[0]
    return np.clip(y, limits[0] - span, limits[1] + span)


def crest(t: np.ndarray, size: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the values of the largest sample in each of several equal time intervals.

    An error that oscillates about zero becomes a line at its amplitude, so that several errors can be compared.

    - `t`: increasing times [samples], s.
    - `size`: absolute values of the error [samples].
    - `columns`: number of intervals.
    """
    if len(t) <= columns:
        return t, size
    starts = column_starts(t, columns)
    ends = np.append(starts[1:], len(t))
    peaks = [start + int(np.argmax(size[start:end])) for start, end in zip(starts, ends, strict=True)]
    x, y = np.append(t[peaks], t[-1]), np.append(size[peaks], size[peaks[-1]])
    # A value near zero is below the logarithmic axis: the line of such a start begins at the first peak.
    return (np.append(t[0], x), np.append(size[0], y)) if size[0] > 1e-3 * y[0] else (x, y)


def zero_line(axes: Axes) -> None:
    """Draw a faint line at zero on `axes`."""
    axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)


def name_runs(figure: Figure, names: Iterable[str], more: Sequence[Any] = ()) -> None:
    """Add a legend to a `figure`: the `names` of runs, with the line styles `LOOKS` in order, and `more` handles."""
    handles = [Line2D([], [], **look, label=name) for name, look in zip(names, LOOKS, strict=False)]
    handles += more
    legend_above(figure, handles, columns=-(-len(handles) // legend_rows(len(handles), figure.get_figwidth())))


def legend_rows(entries: int, width: float) -> int:
    """Return the number of rows of a legend, for its number of `entries` and the figure's `width` [in]."""
    return -(-entries // max(1, int(width / 1.35)))


def draw_pairs(
    runs: Mapping[str, Run], field: str, symbol: str, rate: str, beginning: float
) -> tuple[Figure, np.ndarray]:
    """Draw a quantity of each joint: to the left its beginning, to the right its absolute value, logarithmic.

    Returns the figure and its panels [joints 2].

    - `runs`: runs of the same arm, with logs, by name.
    - `field`: quantity of the log: `e` or `de`.
    - `symbol`: mathematical text with `%d` for the joint's number.
    - `rate`: suffix of the joint's unit: empty or `/s`.
    - `beginning`: duration of the left panels [s].

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    curves = traces_of(runs, field)
    first = next(iter(runs.values()))
    joints = first.joints
    figure = Figure(
        figsize=(WIDTH, ROW * 1.1 * joints + 0.25 + 0.2 * legend_rows(len(runs), WIDTH)), layout="constrained"
    )
    panels = figure.subplots(joints, 2, sharex="col", squeeze=False, width_ratios=[1, 1.15])
    few, most = columns_for(2 * joints * len(runs), 4), columns_for(2 * joints * len(runs), 1)
    sizes = [np.abs(curve.y) for curve in curves]
    # A run that diverges must not set the axis for the others: its curve may leave the panel at the top.
    reached = [
        float(size.max()) for size, run in zip(sizes, runs.values(), strict=True) if run.outcome.ok and size.size
    ]
    top = 10.0 * max(reached, default=np.inf)
    crests = [
        [crest(c.t, np.minimum(size[:, i], top), most) for i in range(joints)]
        for c, size in zip(curves, sizes, strict=True)
    ]
    use_size_axis(panels[:, 1], np.concatenate([size for row in crests for _, size in row]))
    for i, pair in enumerate(panels):
        plain, logarithmic = pair
        starts = [c.t <= max(beginning, float(c.t[1])) for c in curves]
        limits = linear_range([c.y[start, i] for c, start in zip(curves, starts, strict=True)])
        zero_line(plain)
        for c, start, row in zip(curves, starts, crests, strict=True):
            look = {**c.look, "linewidth": 0.95}
            plain.plot(*thin_curve(c.t[start], clip_outside(c.y[start, i], limits), few, limits), **look)
            logarithmic.plot(*_lean_sizes(*row[i], logarithmic.get_ylim()), **look)
        plain.set_ylim(limits)
        unit = f"{first.joint_units[i]}{rate}"
        plain.set_ylabel(joint_label(first, i, symbol, unit))
        logarithmic.set_ylabel(f"$|{symbol % (i + 1)}|$  [{unit}]")
    end = max(float(c.t[-1]) for c in curves)
    use_time_axis(panels[-1, 0], 0.0, min(beginning, end))
    use_time_axis(panels[-1, 1], 0.0, end)
    figure.align_ylabels()
    return figure, panels


def _lean_sizes(t: np.ndarray, size: np.ndarray, limits: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.log10(limits)
    x, y = thin_curve(t, np.log10(np.maximum(size, limits[0] / 10.0)), len(t), (float(low), float(high)))
    return x, 10.0**y


LEVEL: dict[str, Any] = {"color": "0.1", "linewidth": 0.6, "linestyle": "-", "zorder": 3}


@styled
def compared_errors(
    runs: Mapping[str, Run], *, bands: Mapping[str, Sequence[float]] | None = None, beginning: float = 2.0
) -> Figure:
    """Errors of all runs by joint: to the left the beginning, to the right absolute values over the whole run.

    A curve to the right has the largest sample of each short interval, so that an oscillation about zero is a line. The
    envelope is drawn faintly if exactly one run has an envelope.

    - `runs`: runs of the same arm, with logs, by name.
    - `bands`: levels of |e| to draw as horizontal lines, by name, one value per joint [rad or m].
    - `beginning`: duration of the left panels [s].

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    figure, panels = draw_pairs(runs, "e", "e_{%d}", "", beginning)
    more: list[Any] = [Line2D([], [], **LEVEL, label=name) for name in bands or {}]
    promised = [name for name, run in runs.items() if log_of(run).envelope is not None]
    if len(promised) == 1:
        _draw_envelope(panels, runs[promised[0]], beginning)
        more.append(envelope_patch(f"envelope of {promised[0]}"))
    for level in (bands or {}).values():
        for axes, height in zip(panels[:, 1], level, strict=True):
            axes.axhline(height, **LEVEL)
    name_runs(figure, runs, more)
    return figure


def _draw_envelope(panels: np.ndarray, run: Run, beginning: float) -> None:
    """Draw the envelope of a run in the background, and keep the limits of the axes."""
    log = log_of(run)
    if log.envelope is None:
        return
    t, lower, upper = (np.asarray(part) for part in (log.t, log.envelope.lower, log.envelope.upper))
    first = t <= max(beginning, float(t[1]))
    for i, (plain, logarithmic) in enumerate(panels):
        _fill(plain, every_nth(t[first]), every_nth(lower[first, i]), every_nth(upper[first, i]))
        wide = every_nth(np.maximum(np.abs(lower[:, i]), np.abs(upper[:, i])))
        _fill(logarithmic, every_nth(t), np.full_like(wide, logarithmic.get_ylim()[0]), wide)


def _fill(axes: Axes, t: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    limits = axes.get_ylim()
    axes.fill_between(t, low, high, **BAND, zorder=0.4)
    for edge in (low, high):
        axes.plot(t, edge, **{**BOUND, "linewidth": 0.5}, zorder=0.5)
    axes.set_ylim(limits)


@styled
def compared_velocity_errors(runs: Mapping[str, Run], *, beginning: float = 2.0) -> Figure:
    """Velocity errors of all runs by joint: to the left the beginning, to the right absolute values over the whole run.

    - `runs`: runs of the same arm, with logs, by name.
    - `beginning`: duration of the left panels [s].

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    figure, _ = draw_pairs(runs, "de", r"\dot{e}_{%d}", "/s", beginning)
    name_runs(figure, runs)
    return figure


DESIRED: dict[str, Any] = {"color": "0.7", "linewidth": 3.2, "linestyle": "-", "solid_capstyle": "butt"}


@styled
def compared_tip_paths(paths: Mapping[str, np.ndarray], desired: np.ndarray) -> Figure:
    """Tip paths of all schemes over the desired path, seen from above; also from the side if the desired path rises.

    Each path starts at a ring. The axes exceed the desired path by at most its size, or by twice its size to show the
    start of a path. Parts of a path beyond the axes are cut off.

    - `paths`: tip positions [samples 3], m, by name.
    - `desired`: desired tip positions [samples 3], m.

    Raises DefinitionError if there are no paths or too many.
    """
    require_looks(paths)
    goal = np.asarray(desired)
    low, high = _box([np.asarray(path) for path in paths.values()], goal)
    rises = bool(np.ptp(goal[:, 2]) > 1e-9)
    views = [(0, 1), (0, 2)] if rises else [(0, 1)]
    spans = np.maximum(high - low, 1e-9)
    ratios = [float(np.clip(spans[across] / spans[up], 0.5, 2.0)) for across, up in views]
    width = min(WIDTH, max(SMALL, 2.8 * sum(ratios) + 0.8 * len(views)))
    figure = Figure(figsize=(width, 3.5 + 0.2 * legend_rows(len(paths) + 1, width)), layout="compressed")
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=ratios)[0]
    for axes, (across, up) in zip(panels, views, strict=True):
        axes.plot(*every_nth(goal[:, [across, up]], 300).T, **DESIRED, zorder=1.8)
        for path, look in zip(paths.values(), LOOKS, strict=False):
            # Clip a straying path far outside the picture, where the clipping is not visible.
            points = np.clip(np.asarray(path), low - spans.max(), high + spans.max())[:, [across, up]]
            axes.plot(*_thin_path(points, POINTS // (3 * len(paths) * len(views))).T, **{**look, "linewidth": 1.0})
            axes.plot(*points[0], marker="o", markersize=4.5, markerfacecolor="white", markeredgecolor="0.2", zorder=4)
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
    """Return the lowest and the highest corner of the picture [3], m.

    A path may exceed the desired path by at most the desired path's size, a start by twice as much.
    """
    reach = np.ptp(goal, axis=0).max() or 1.0
    near = [path[0] for path in paths if np.abs(path[0] - goal[0]).max() < 2.0 * reach]
    shown = np.concatenate([goal, *(start[None] for start in near)])
    low, high = shown.min(axis=0), shown.max(axis=0)
    for path in paths:
        low = np.minimum(low, np.maximum(np.nanmin(path, axis=0), goal.min(axis=0) - reach))
        high = np.maximum(high, np.minimum(np.nanmax(path, axis=0), goal.max(axis=0) + reach))
    gap = 0.07 * (high - low).max()
    return low - gap, high + gap


def _thin_path(points: np.ndarray, most: int) -> np.ndarray:
    """Select points of a path, half of them evenly along its length and half evenly in time."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    each = min(200, most)
    even = np.searchsorted(way, np.linspace(0.0, way[-1], each)).clip(0, len(points) - 1)
    chosen = np.unique(np.concatenate([even, np.linspace(0, len(points) - 1, each).round().astype(int)]))
    return points[chosen]


HATCHES = ("", "////", "----", "xxxx", "\\\\\\\\", "||||", "++++", "//", "--", "\\\\", "xx", "||", "-|")
"""Hatches of the first, second, ... scheme, distinct without colour; lines only, since dots make large SVGs."""


@styled
def metric_bars(
    values: Mapping[str, Sequence[float | None]], label: str, joints: Sequence[str] | None = None
) -> Figure:
    """One group of bars per joint, with one bar per scheme, on a logarithmic axis.

    A value that is zero, not finite or missing is a dash.

    - `values`: by scheme, one value per joint, >= 0.
    - `label`: label of the axis, with the unit.
    - `joints`: names of the joints; by default numbers.

    Raises DefinitionError if there are no schemes, too many, or they have different numbers of joints.
    """
    require_looks(values)
    if len({len(row) for row in values.values()}) != 1:
        raise DefinitionError("all schemes need the same number of values, one per joint")
    table = np.array([list(row) for row in values.values()], dtype=float)
    drawn = np.where(np.isfinite(table) & (table > 0), table, np.nan)
    across = min(WIDTH, 4.3 + 0.12 * table.size)
    rows = legend_rows(len(table), across)
    figure = Figure(figsize=(across, 2.5 + 0.2 * rows), layout="constrained")
    axes = figure.subplots()
    width = 0.8 / len(table)
    low, high = _decades(drawn)
    handles = []
    for i, (name, row) in enumerate(zip(values, drawn, strict=True)):
        color = LOOKS[i]["color"]
        skin = {"facecolor": color if i == 0 else "white", "edgecolor": color, "hatch": HATCHES[i], "linewidth": 0.8}
        positions = np.arange(table.shape[1]) + (i - 0.5 * (len(table) - 1)) * width
        there = np.isfinite(row)
        axes.bar(positions[there], row[there] - low, 0.86 * width, bottom=low, **skin)
        for position in positions[~there]:
            axes.annotate("–", (position, low), xytext=(0, 3), textcoords="offset points", ha="center", color=color)
        handles.append(Patch(**skin, label=name))
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    use_plain_ticks(axes.yaxis, low, high)
    axes.set_ylabel(label)
    axes.set_xticks(range(table.shape[1]), joints or [f"joint {i + 1}" for i in range(table.shape[1])])
    axes.set_xlim(-0.55, table.shape[1] - 0.45)
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    legend_above(figure, handles, columns=-(-len(table) // rows))
    return figure


def _decades(drawn: np.ndarray) -> tuple[float, float]:
    """Return the ends of the axis: a power of ten below the least value, which shows its bar; above the largest."""
    if not np.isfinite(drawn).any():
        return 0.1, 10.0
    low, high = np.log10(np.nanmin(drawn)), np.log10(np.nanmax(drawn))
    return float(10.0 ** np.floor(low - 0.35)), float(10.0 ** (high + 0.12 * max(1.0, high - np.floor(low - 0.35))))
