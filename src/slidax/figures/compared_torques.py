"""The torques of several schemes on the same task, some of which chatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from slidax.simulation import Run

from .axes import use_time_axis
from .limits import draw_limit, limit_handle
from .logged import joint_label
from .overlay import (
    SPAN,
    Trace,
    clipped,
    columns_for,
    legend_rows,
    linear_range,
    name_runs,
    traces_of,
    zero_line,
)
from .style import ROW, WIDTH, styled
from .thinning import column_starts, thinned

TURNS, SHARE = 3, 0.15
"""A torque that turns around so often within one column, and at such a share of its samples, chatters there."""

SAMPLES = 20
"""A column has at least so many, or its turns could not be counted."""

NEIGHBOURS = 30
"""A band reaches from the lowest to the highest of so many samples before and after."""


@styled
def compared_torques(
    runs: Mapping[str, Run], *, limits: Sequence[float] | np.ndarray | None = None, beginning: float = 2.0
) -> Figure:
    """Per joint: the torques of all runs over the whole run, and to the right over the beginning.

    Where a torque chatters, its range is drawn as a tinted band between its lowest and highest values. Over the whole
    run, peaks far above all else leave the axis; the beginning shows them in full.

    - `runs`: finished runs of the same arm with logs, by the name that the legend gives them.
    - `limits`: largest torque of each joint's drive [N m or N], to draw beside them.
    - `beginning`: how long the beginning is [s].

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    curves = traces_of(runs, "tau")
    first = next(iter(runs.values()))
    units = first.torque_units
    figure = Figure(
        figsize=(WIDTH, ROW * 1.1 * len(units) + 0.25 + 0.2 * legend_rows(len(runs), WIDTH)), layout="constrained"
    )
    panels = figure.subplots(len(units), 2, sharex="col", squeeze=False, width_ratios=[1.6, 1])
    columns = columns_for(2 * len(units) * len(runs), 4)
    end = max(float(c.t[-1]) for c in curves)
    spans = ((end, SPAN), (min(beginning, end), np.inf))
    for axes_column, (until, span) in zip(panels.T, spans, strict=True):
        for i, axes in enumerate(axes_column):
            seen = [c.t <= max(until, float(c.t[1])) for c in curves]
            shown = linear_range([c.y[s, i] for c, s in zip(curves, seen, strict=True)], span)
            zero_line(axes)
            for c, s in zip(curves, seen, strict=True):
                _draw(axes, Trace(c.t[s], clipped(c.y[s, i], shown), c.look), columns, shown)
            axes.set_ylim(shown)
        use_time_axis(axes_column[-1], 0.0, until)
    for i, unit in enumerate(units):
        panels[i, 0].set_ylabel(joint_label(first, i, r"\tau_{%d}", unit))
        if limits is not None:
            draw_limit(panels[i], float(limits[i]), unit)
    figure.align_ylabels()
    name_runs(figure, runs, [] if limits is None else [limit_handle()])
    return figure


def _draw(axes: Axes, curve: Trace, columns: int, limits: tuple[float, float]) -> None:
    t, y = curve.t, curve.y
    wide, columns = columns, max(1, min(columns, len(t) // SAMPLES))
    chatters = _chatters(t, y, columns)
    if not chatters.any():
        axes.plot(*thinned(t, y, wide, limits), **{**curve.look, "linewidth": 0.9})
        return
    starts = column_starts(t, columns)
    ends = np.append(starts[1:], len(t))
    middle = 0.5 * (t[starts] + t[ends - 1])
    # Over some neighbours too: the few samples of one column need not meet both ends of a switching torque.
    reach = max(1, round(NEIGHBOURS * len(starts) / len(t)))
    low, high = (np.where(chatters, _widest(f, y, starts, chatters, reach), np.nan) for f in (np.minimum, np.maximum))
    color = curve.look["color"]
    axes.fill_between(middle, low, high, facecolor=color, alpha=0.16, edgecolor="none", zorder=1.6)
    for edge in (low, high):
        axes.plot(middle, edge, **{**curve.look, "linewidth": 0.5}, zorder=1.9)
    # The rest as lines between the bands.
    calm = np.repeat(~chatters, ends - starts)
    for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(calm.astype(int))) + 1):
        if len(part) > 1 and calm[part[0]]:
            share = max(2, round(wide * len(part) / len(t)))
            axes.plot(*thinned(t[part], y[part], share, limits), **{**curve.look, "linewidth": 0.9})


def _widest(pick: np.ufunc, y: np.ndarray, starts: np.ndarray, chatters: np.ndarray, reach: int) -> np.ndarray:
    """The lowest or highest value of each column and its neighbours, of those only where the torque chatters."""
    nothing = np.inf if pick is np.minimum else -np.inf
    padded = np.pad(np.where(chatters, pick.reduceat(y, starts), nothing), reach, constant_values=nothing)
    widest: np.ndarray = pick.reduce([padded[i : i + len(starts)] for i in range(2 * reach + 1)])
    return widest


def _chatters(t: np.ndarray, y: np.ndarray, columns: int) -> np.ndarray:
    """Whether the torque chatters, per column; short pauses and short bursts follow their neighbours."""
    starts = column_starts(t, columns)
    step = np.diff(y)
    turns = np.concatenate([[0], (step[1:] * step[:-1] < 0).astype(int), [0]])
    samples = np.diff(np.append(starts, len(t)))
    often = np.add.reduceat(turns, starts) >= np.maximum(TURNS, SHARE * samples)
    # The torque must go to and fro, and far enough to be seen: a ramp with ripples does not, nor does rounding.
    height = np.maximum.reduceat(y, starts) - np.minimum.reduceat(y, starts)
    way = np.add.reduceat(np.abs(np.append(step, 0.0)), starts)
    seen = (way > 2.5 * height) & (height > 0.004 * np.ptp(y))
    votes = np.convolve(np.pad((often & seen).astype(int), 2, mode="edge"), np.ones(5, int), mode="valid")
    majority: np.ndarray = votes >= 2
    return majority
