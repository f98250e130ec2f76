"""Torques of several runs, with chattering drawn as a band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import maximum_filter1d, minimum_filter1d, percentile_filter, uniform_filter1d

from slidax.simulation.run import Run

from .compared import SPAN, Trace, clip_outside, columns_for, legend_rows, linear_range, name_runs, traces_of, zero_line
from .style import ROW, WIDTH, column_starts, draw_limit, joint_label, limit_handle, styled, thin_curve, use_time_axis

SWINGS = 15
"""A swing is half the distance of a turning point from the mean of its two neighbours: the amplitude of an oscillation.
It is compared with this many swings before it, and as many after it.
"""

SAMPLES = 8.0
"""A torque with more samples between its turning points, on average, does not chatter."""

LONGEST = 40
"""A band ends after this many samples without a turning point."""

SEEN = 0.006
"""A swing below this share of the axis is hidden by the line's own width."""

OUTLIER = 3.0
"""A swing this many times larger than the upper quartile of the swings around it is a step, not chattering."""


class ChatterInterval(NamedTuple):
    """An interval of time in which a torque chatters.

    - `first`, `last`: indices of its first and last sample.
    - `t`: times of its turning points [points], s.
    - `low`, `high`: range of the torque near these times [points].
    """

    first: int
    last: int
    t: np.ndarray
    low: np.ndarray
    high: np.ndarray


def chatter(t: np.ndarray, y: np.ndarray, height: float) -> list[ChatterInterval]:
    """Return the intervals in which a torque oscillates quickly, with an amplitude that is visible in the figure.

    The oscillation is measured relative to a moving average of its turning points. A steep transient therefore does not
    widen the band.

    - `t`: increasing times [samples], s.
    - `y`: torque of one joint [samples].
    - `height`: height of the figure's axis, in the unit of the torque.
    """
    step = np.diff(y)
    turns = np.flatnonzero(step[1:] * step[:-1] < 0) + 1
    if len(turns) <= SWINGS:
        return []
    peaks = y[turns]
    around = np.pad(peaks, 1, mode="reflect")
    middle = 0.25 * around[:-2] + 0.5 * peaks + 0.25 * around[2:]
    swing, window = peaks - middle, 2 * SWINGS + 1
    # A high quantile, since a log of every tenth sample has swings of all sizes; not the maximum, which may be a
    # transient.
    usual = percentile_filter(np.abs(swing), 75, window, mode="reflect")
    pace = uniform_filter1d(np.gradient(turns.astype(float)), window, mode="reflect")
    often = (usual > SEEN * height) & (pace <= SAMPLES)
    chatters = uniform_filter1d(often.astype(float), 2 * window, mode="reflect") > 0.4
    steps = np.abs(swing) > OUTLIER * usual
    swing = np.where(steps, 0.0, swing)
    low, high = middle + minimum_filter1d(swing, window), middle + maximum_filter1d(swing, window)
    stretches = []
    breaks = (np.diff(chatters.astype(int)) != 0) | (np.diff(turns) > LONGEST)
    for part in np.split(np.arange(len(turns)), np.flatnonzero(breaks) + 1):
        # A step near an end belongs to the motion before or after it.
        ends = [share[steps[share]] for share in (part[:SWINGS], part[-SWINGS:])]
        part = part[(part > ends[0].max(initial=-1)) & (part < ends[1].min(initial=len(turns)))]
        if len(part) > SWINGS and chatters[part[0]]:
            stretches.append(
                ChatterInterval(int(turns[part[0]]), int(turns[part[-1]]), t[turns[part]], low[part], high[part])
            )
    return stretches


@styled
def compared_torques(
    runs: Mapping[str, Run], *, limits: Sequence[float] | np.ndarray | None = None, beginning: float = 2.0
) -> Figure:
    """Torques of all runs by joint: to the left the whole run, to the right its beginning.

    A chattering torque is a tinted band between its lowest and highest values. To the left, peaks far above all other
    values are cut off; the right panels show peaks in full.

    - `runs`: runs of the same arm, with logs, by name.
    - `limits`: largest torque of each joint's drive [N m or N].
    - `beginning`: duration of the right panels [s].

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
            masks = [c.t <= max(until, float(c.t[1])) for c in curves]
            shown = linear_range([c.y[s, i] for c, s in zip(curves, masks, strict=True)], span)
            zero_line(axes)
            for c, s in zip(curves, masks, strict=True):
                _draw(axes, Trace(c.t[s], clip_outside(c.y[s, i], shown), c.look), columns, shown)
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
    t, y, look = curve.t, curve.y, curve.look
    gap = (np.array([np.nan]),) * 3
    lines, bands = [], []
    calm_from = 0
    for band in [*chatter(t, y, limits[1] - limits[0]), None]:
        calm = slice(calm_from, len(t) if band is None else band.first + 1)
        if calm.stop - calm.start > 1:
            share = max(2, round(columns * (calm.stop - calm.start) / len(t)))
            lines += [thin_curve(t[calm], y[calm], share, limits), gap[:2]]
        if band is not None:
            share = max(3, round(columns * (band.last - band.first) / len(t)))
            starts = column_starts(band.t, share)
            low, high = np.minimum.reduceat(band.low, starts), np.maximum.reduceat(band.high, starts)
            # Extend the band to the end of the interval, where the line continues.
            ends = np.append(band.t[starts], band.t[-1]), np.append(low, low[-1]), np.append(high, high[-1])
            bands += [ends, gap]
            calm_from = band.last
    # A single line with gaps instead of many lines keeps the file small.
    if lines:
        axes.plot(*map(np.concatenate, zip(*lines, strict=True)), **{**look, "linewidth": 0.9})
    if bands:
        times, low, high = map(np.concatenate, zip(*bands, strict=True))
        axes.fill_between(times, low, high, facecolor=look["color"], alpha=0.16, edgecolor="none", zorder=1.6)
        for edge in (low, high):
            axes.plot(times, edge, **{**look, "linewidth": 0.5}, zorder=1.9)
