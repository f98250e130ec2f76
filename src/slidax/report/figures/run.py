"""Figures of one run: errors in the envelope, torques, tip path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.core.types import Envelope
from slidax.identify import LogFit
from slidax.law.envelopes import AbstractPerformance
from slidax.simulation.run import Run

from .style import (
    BAND,
    BOUND,
    LINES,
    NARROW,
    ROW,
    WIDTH,
    draw_limit,
    envelope_patch,
    every_nth,
    joint_label,
    legend_above,
    limit_handle,
    log_of,
    styled,
    thin_curve,
    use_size_axis,
    use_time_axis,
)


@styled
def tracking_error(run: Run, *, window: tuple[float, float] | None = None) -> Figure:
    """Tracking error by joint: left in its envelope (eq. (12) of the paper), right its absolute value, logarithmic.

    - `run`: run with a log.
    - `window`: first and last time to draw [s]; by default the whole run.

    Raises DefinitionError if the run has no log.
    """
    log = log_of(run)
    t = np.asarray(log.t)
    chosen = slice(None) if window is None else (t >= window[0]) & (t <= window[1])
    t, e = t[chosen], np.asarray(log.e)[chosen]
    figure = Figure(figsize=(WIDTH, ROW * run.joints + 0.55), layout="constrained")
    panels = figure.subplots(run.joints, 2, sharex=True, squeeze=False, width_ratios=[1.15, 1])
    bounds = None if log.envelope is None else _bounds(log.envelope, chosen)
    use_size_axis(panels[:, 1], np.abs(e) if bounds is None else np.append(np.abs(e), np.abs(bounds).max()))
    sides = False
    for i, unit in enumerate(run.joint_units):
        plain, logarithmic = panels[i]
        if bounds is not None:
            _draw_envelope(plain, t, *bounds[..., i])
            narrow, wide = np.sort(np.abs(bounds[..., i]), axis=0)
            _draw_radii(logarithmic, t, narrow, wide)
            sides |= bool(np.any(narrow < wide))
        plain.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
        plain.plot(*thin_curve(t, e[:, i]), **LINES[0])
        plain.set_ylabel(joint_label(run, i, "e_{%d}", unit))
        logarithmic.plot(*thin_curve(t, np.abs(e[:, i])), **{**LINES[0], "linewidth": 0.9})
        logarithmic.set_ylabel(rf"$|e_{{{i + 1}}}|$  [{unit}]")
    for axes in panels[-1]:
        use_time_axis(axes, float(t[0]), float(t[-1]))
    handles: list[Artist] = [Line2D([], [], **LINES[0], label="error")]
    if log.envelope is not None:
        handles.append(envelope_patch())
    if sides:
        handles.append(Line2D([], [], **NARROW, label="its narrower side"))
    legend_above(figure, handles)
    figure.align_ylabels()
    return figure


def _bounds(envelope: Envelope, chosen: slice | np.ndarray) -> np.ndarray:
    return np.stack([np.asarray(envelope.lower)[chosen], np.asarray(envelope.upper)[chosen]])


def _draw_envelope(axes: Axes, t: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    time, low, high = every_nth(t), every_nth(lower), every_nth(upper)
    axes.fill_between(time, low, high, **BAND, label="envelope")
    axes.plot(time, low, **BOUND)
    axes.plot(time, high, **BOUND)


def _draw_radii(axes: Axes, t: np.ndarray, narrow: np.ndarray, wide: np.ndarray) -> None:
    """Below the narrower side an error of either sign is inside; above the wider side it is outside."""
    time, low, high = every_nth(t), every_nth(narrow), every_nth(wide)
    axes.fill_between(time, axes.get_ylim()[0], high, **BAND, label="envelope")
    axes.plot(time, high, **BOUND)
    axes.plot(time, low, **NARROW)


@styled
def velocity_error(run: Run, *, beginning: float = 2.0) -> Figure:
    """Velocity error by joint: to the left the beginning, to the right its absolute value over the whole run.

    - `run`: run with a log.
    - `beginning`: duration of the left panels [s].

    Raises DefinitionError if the run has no log.
    """
    log = log_of(run)
    t, de = np.asarray(log.t), np.asarray(log.de)
    first = t <= max(beginning, float(t[1]))
    figure = Figure(figsize=(WIDTH, ROW * run.joints + 0.25), layout="constrained")
    panels = figure.subplots(run.joints, 2, sharex="col", squeeze=False, width_ratios=[1, 1.15])
    use_size_axis(panels[:, 1], np.abs(de))
    for i, unit in enumerate(run.joint_units):
        plain, logarithmic = panels[i]
        plain.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
        plain.plot(*thin_curve(t[first], de[first, i]), **LINES[0])
        plain.set_ylabel(joint_label(run, i, r"\dot{e}_{%d}", f"{unit}/s"))
        logarithmic.plot(*thin_curve(t, np.abs(de[:, i])), **{**LINES[0], "linewidth": 0.9})
        logarithmic.set_ylabel(rf"$|\dot{{e}}_{{{i + 1}}}|$  [{unit}/s]")
    for axes, end in zip(panels[-1], (t[first][-1], t[-1]), strict=True):
        use_time_axis(axes, float(t[0]), float(end))
    figure.align_ylabels()
    return figure


@styled
def torque(run: Run, *, limits: Sequence[float] | np.ndarray | None = None, beginning: float = 2.0) -> Figure:
    """Torque by joint: to the left the whole run, to the right its beginning.

    - `run`: run with a log.
    - `limits`: largest torque of each joint's drive [N m or N].
    - `beginning`: duration of the right panels [s].

    Raises DefinitionError if the run has no log.
    """
    log = log_of(run)
    t, tau = np.asarray(log.t), np.asarray(log.tau)
    first = t <= max(beginning, float(t[1]))
    figure = Figure(figsize=(WIDTH, ROW * run.joints + 0.25), layout="constrained")
    panels = figure.subplots(run.joints, 2, sharex="col", squeeze=False, width_ratios=[1.6, 1])
    for i, unit in enumerate(run.torque_units):
        whole, zoomed = panels[i]
        whole.plot(*thin_curve(t, tau[:, i]), **LINES[0])
        zoomed.plot(*thin_curve(t[first], tau[first, i]), **LINES[0])
        whole.set_ylabel(joint_label(run, i, r"\tau_{%d}", unit))
        for axes in (whole, zoomed):
            axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
            axes.margins(y=0.08)
        if limits is not None:
            draw_limit(panels[i], float(limits[i]), unit)
    for axes, end in zip(panels[-1], (t[-1], t[first][-1]), strict=True):
        use_time_axis(axes, float(t[0]), float(end))
    if limits is not None:
        legend_above(figure, [Line2D([], [], **LINES[0], label="torque"), limit_handle()])
    figure.align_ylabels()
    return figure


MARKS = {"start": "o", "end": "s"}


@styled
def tip_path(actual: np.ndarray, desired: np.ndarray) -> Figure:
    """The tip's path and the desired one, seen from above, and from the side if the tip also moves vertically.

    - `actual`, `desired`: tip positions over time [samples 3], m.
    """
    actual, desired = np.asarray(actual), np.asarray(desired)
    rises = np.ptp(np.concatenate([actual, desired])[:, 2]) > 1e-9
    views = [(0, 1), (0, 2)] if rises else [(0, 1)]
    spans = np.ptp(np.concatenate([actual, desired]), axis=0)
    ratios = [float(np.clip(spans[across] / max(spans[up], 1e-12), 0.25, 2.0)) for across, up in views]
    figure = Figure(figsize=(min(WIDTH, max(3.8, 2.6 * sum(ratios) + 0.8 * len(views))), 3.6), layout="compressed")
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=ratios)[0]
    for axes, (across, up) in zip(panels, views, strict=True):
        _draw(axes, actual[:, [across, up]], desired[:, [across, up]])
        axes.set_xlabel(f"${'xyz'[across]}$  [m]")
        axes.set_ylabel(f"${'xyz'[up]}$  [m]")
        if rises:
            axes.set_title("from above" if up == 1 else "from the side")
    mark: dict[str, Any] = {"color": "0.2", "linestyle": "none", "markerfacecolor": "white", "markersize": 5.0}
    legend_above(
        figure,
        [
            Line2D([], [], **LINES[1], label="desired"),
            Line2D([], [], **LINES[0], label="actual"),
            *(Line2D([], [], **mark, marker=shape, label=name) for name, shape in MARKS.items()),
        ],
    )
    return figure


def _draw(axes: Axes, actual: np.ndarray, desired: np.ndarray) -> None:
    axes.plot(*actual.T, **{**LINES[0], "linewidth": 1.5})
    axes.plot(*desired.T, **{**LINES[1], "linewidth": 1.1})
    for path, line in ((actual, LINES[0]), (desired, LINES[1])):
        for point, shape in zip((path[0], path[-1]), MARKS.values(), strict=True):
            mark: dict[str, Any] = {"markersize": 5.0, "markerfacecolor": "white", "markeredgecolor": line["color"]}
            axes.plot(*point, marker=shape, linestyle="none", **mark, zorder=4)
    axes.set_aspect("equal", adjustable="box")
    axes.margins(0.08)


LEVEL: dict[str, Any] = {"color": "0.1", "linewidth": 0.7, "linestyle": "-", "zorder": 3}


@styled
def error_sizes(runs: Mapping[str, Run], *, levels: Mapping[str, Sequence[float]] | None = None) -> Figure:
    """Absolute errors of several runs by joint, on a logarithmic axis, with levels for comparison.

    - `runs`: runs with logs, by name.
    - `levels`: heights of horizontal lines by name, one value per joint [rad or m].

    Raises DefinitionError if there are no runs, more than five, or one without a log.
    """
    if not 1 <= len(runs) <= len(LINES):
        raise DefinitionError(f"this figure shows 1 to {len(LINES)} runs; got {len(runs)}")
    first = next(iter(runs.values()))
    logs = [log_of(run) for run in runs.values()]
    figure = Figure(figsize=(WIDTH, ROW * 1.1 * first.joints + 0.55), layout="constrained")
    panels = figure.subplots(first.joints, 1, sharex=True, squeeze=False)[:, 0]
    use_size_axis(panels, np.concatenate([np.abs(np.asarray(log.e)).ravel() for log in logs]))
    lowest = min((min(level) for level in (levels or {}).values()), default=np.inf)
    if lowest <= panels[0].get_ylim()[0]:
        for axes in panels:
            axes.set_ylim(bottom=0.1 * lowest)
    for i, (axes, unit) in enumerate(zip(panels, first.joint_units, strict=True)):
        for log, line in zip(logs, LINES, strict=False):
            axes.plot(*thin_curve(np.asarray(log.t), np.abs(np.asarray(log.e)[:, i])), **{**line, "linewidth": 0.9})
        for level in (levels or {}).values():
            axes.axhline(level[i], **LEVEL)
        axes.set_ylabel(joint_label(first, i, "|e_{%d}|", unit))
    use_time_axis(panels[-1], 0.0, max(float(log.t[-1]) for log in logs))
    handles = [Line2D([], [], **line, label=name) for name, line in zip(runs, LINES, strict=False)]
    handles += [Line2D([], [], **LEVEL, label=name) for name in levels or {}]
    legend_above(figure, handles)
    figure.align_ylabels()
    return figure


@styled
def performance(functions: Mapping[str, AbstractPerformance], t: np.ndarray) -> Figure:
    """Performance functions ρ(t), the radii of envelopes over time, on a logarithmic axis.

    - `functions`: performance functions of one joint each, by name.
    - `t`: times [k], s.

    Raises DefinitionError if there are none, more than five, or one with several joints.
    """
    if not 1 <= len(functions) <= len(LINES):
        raise DefinitionError(f"this figure shows 1 to {len(LINES)} functions; got {len(functions)}")
    figure = Figure(figsize=(6.2, 3.1), layout="constrained")
    axes = figure.subplots()
    times = jnp.asarray(t, float)
    lines = []
    for (name, function), line in zip(functions.items(), LINES, strict=False):
        radius = np.asarray(jax.vmap(function.radius)(times))
        if radius.ndim != 1:
            raise DefinitionError(f"`{name}` has {radius.shape[1]} joints; give one function per joint")
        lines += axes.plot(every_nth(np.asarray(t)), every_nth(radius), **line, label=name)
    axes.set_yscale("log")
    use_time_axis(axes, float(t[0]), float(t[-1]))
    axes.set_ylabel(r"$\rho$  [rad or m]")
    legend_above(figure, lines, columns=None if len(lines) < 5 else 3)
    return figure


@styled
def identified_torques(robot: Articulated, fit: LogFit) -> Figure:
    """Torques by joint: to the left measured and predicted, to the right their difference. The held-out part is shaded.

    - `robot`: the identified arm.
    - `fit`: the log, with measured and predicted torques in the band of the identification's filter.
    """
    t, n = fit.t - fit.t[0], robot.joints
    figure = Figure(figsize=(WIDTH, ROW * n + 0.25), layout="constrained")
    panels = figure.subplots(n, 2, sharex="col", squeeze=False, width_ratios=[1.6, 1])
    left = fit.measured - fit.predicted
    for i, unit in enumerate(robot.torque_units):
        whole, rest = panels[i]
        whole.plot(*thin_curve(t, fit.measured[:, i]), **LINES[0])
        whole.plot(*thin_curve(t, fit.predicted[:, i]), **LINES[1])
        rest.plot(*thin_curve(t, left[:, i]), **LINES[2])
        # At the log's ends the filter has too few samples; its large errors there would flatten the rest of the curve.
        largest = max(1.5 * float(np.quantile(np.abs(left[:, i]), 0.98)), 1e-12)
        rest.set_ylim(-largest, largest)
        whole.set_ylabel(joint_label(robot, i, r"\tau_{%d}", unit))
        for axes in (whole, rest):
            axes.axvspan(float(t[fit.split]), float(t[-1]), zorder=0.5, **BAND)
            axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
    for axes in panels[-1]:
        use_time_axis(axes, 0.0, float(t[-1]))
    names = ("measured", "predicted", "difference")
    lines = [Line2D([], [], **look, label=name) for look, name in zip(LINES, names, strict=False)]
    legend_above(figure, [*lines, Patch(facecolor=BAND["facecolor"], edgecolor="0.6", label="held out")])
    figure.align_ylabels()
    return figure
