"""Figures of a control loop: frequency response, certified bounds, latencies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import (
    BAND,
    BOUND,
    LIMIT,
    LINES,
    NARROW,
    SMALL,
    WIDTH,
    envelope_patch,
    every_nth,
    legend_above,
    styled,
    use_size_axis,
    use_time_axis,
)


@styled
def bode(frequencies: np.ndarray, loops: Mapping[str, np.ndarray], title: str = "") -> Figure:
    """Magnitude and phase of loops over the frequency, up to half of the sampling frequency.

    - `frequencies`: frequencies [k], rad/s.
    - `loops`: complex frequency responses of the open loops [k], by name.
    - `title`: title of the figure: the point at which the loops are broken open.
    """
    figure = Figure(figsize=(SMALL, 4.0), layout="constrained")
    size, phase = figure.subplots(2, 1, sharex=True)
    for number, response in enumerate(loops.values()):
        look = _look(number)
        size.plot(frequencies, np.abs(response), **look)
        turned = np.degrees(np.unwrap(np.angle(response)))
        # Shift by whole turns, so that the phase is near -180 degrees where the loop last has magnitude 1.
        crossed = np.flatnonzero(np.abs(response) >= 1.0)
        turned = turned - 360.0 * np.round((turned[crossed[-1] if len(crossed) else 0] + 180.0) / 360.0)
        phase.plot(frequencies, turned, **look)
    size.axhline(1.0, **NARROW)
    phase.axhline(-180.0, **NARROW)
    size.set_xscale("log")
    size.set_yscale("log")
    size.set_ylabel("|L|")
    phase.set_ylabel("phase  [degrees]")
    phase.set_xlabel("frequency  [rad/s]")
    if title:
        size.set_title(title)
    _legend(figure, loops)
    return figure


@styled
def nyquist(loops: Mapping[str, np.ndarray], disks: Mapping[str, float], title: str = "") -> Figure:
    """Open loops in the complex plane, with the point -1 and the disk of the smallest disk margin around it.

    - `loops`: complex frequency responses of the open loops [k], by name.
    - `disks`: disk margins of the loops, by name.
    - `title`: title of the figure: the point at which the loops are broken open.
    """
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.subplots()
    for number, response in enumerate(loops.values()):
        axes.plot(response.real, response.imag, **_look(number))
    axes.plot(-1.0, 0.0, marker="+", color="0.1", markersize=7.0)
    least = min(disks.values(), default=0.0)
    if 0.0 < least < 2.0:
        near, far = -(2.0 - least) / (2.0 + least), -(2.0 + least) / (2.0 - least)
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.plot(0.5 * (near + far) + 0.5 * (near - far) * np.cos(turn), 0.5 * (near - far) * np.sin(turn), **NARROW)
    axes.set_xlim(-3.0, 1.5)
    axes.set_ylim(-2.25, 2.25)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("Re L")
    axes.set_ylabel("Im L")
    if title:
        axes.set_title(title)
    _legend(figure, loops)
    return figure


def _look(number: int) -> dict[str, Any]:
    """Return the line style of a loop; after the last style they repeat, with narrower lines."""
    return {**LINES[number % len(LINES)], "linewidth": 1.1 if number < len(LINES) else 0.6}


def _legend(figure: Figure, loops: Mapping[str, np.ndarray]) -> None:
    handles = [Line2D([], [], label=name, **_look(number)) for number, name in enumerate(loops)]
    legend_above(figure, handles, columns=min(len(handles), 4))


COLUMNS = 3


@styled
def bounded_error(
    t: np.ndarray,
    radii: np.ndarray,
    bounds: Mapping[str, tuple[np.ndarray, np.ndarray]],
    names: Sequence[str],
    units: Sequence[str],
) -> Figure:
    """Absolute values of both sides of the envelope, and bounds of |e|, by joint, on a logarithmic axis.

    - `t`: times [times], s.
    - `radii`: absolute values of the narrower and the wider side [2 times joints], rad or m.
    - `bounds`: times [k], s, and bounds of |e| at these times [k joints], by name.
    - `names`, `units`: names and units of the joints.
    """
    joints = radii.shape[2]
    columns = min(COLUMNS, joints)
    rows = -(-joints // columns)
    figure = Figure(figsize=(SMALL, 1.6 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True)
    sizes = np.concatenate([radii.ravel(), *(size.ravel() for _, size in bounds.values())])
    # The axis omits rare small values. A bound may cover only a part of the time, so its least value is repeated.
    use_size_axis(panels.ravel(), np.append(np.full(99, sizes[sizes > 0].min()), sizes.max()))
    time = every_nth(t)
    handles: list[Artist] = [envelope_patch()]
    if np.any(radii[0] < radii[1]):
        handles.append(Line2D([], [], **NARROW, label="its narrower side"))
    handles += [Line2D([], [], **line, label=name) for name, line in zip(bounds, LINES, strict=False)]
    for joint, axes in enumerate(panels.ravel()[:joints]):
        low, high = (every_nth(side[:, joint]) for side in radii)
        axes.fill_between(time, axes.get_ylim()[0], high, **BAND)
        axes.plot(time, high, **BOUND)
        axes.plot(time, low, **NARROW)
        for (times, size), line in zip(bounds.values(), LINES, strict=False):
            axes.plot(every_nth(times), every_nth(size[:, joint]), **line)
        use_time_axis(axes, float(t[0]), float(t[-1]))
        axes.set_title(f"{names[joint]}  [{units[joint]}]")
        last, first = joint + columns >= joints, joint % columns == 0
        axes.tick_params(labelbottom=last, labelleft=first)
        axes.set_ylabel("$|e|$" if first else "")
        axes.set_xlabel("$t$  [s]" if last else "")
    for axes in panels.ravel()[joints:]:
        axes.set_visible(False)
    legend_above(figure, handles, columns=min(len(handles), 3))
    return figure


BINS = 120
LEAST = 0.2
"""Start of the axis [µs]; a shorter time counts as this one."""


@styled
def latencies(times: Mapping[str, np.ndarray], period: float) -> Figure:
    """Histogram of the control loop's latencies, on logarithmic axes that show rare delays.

    - `times`: latencies of all ticks by name, s.
    - `period`: sample time, drawn as a line [s].
    """
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    axes = figure.subplots()
    longest = max([1e6 * period, *(1e6 * float(values.max()) for values in times.values() if len(values))])
    edges = np.geomspace(LEAST, 1.5 * longest, BINS + 1)
    for number, (name, values) in enumerate(times.items()):
        counts, _ = np.histogram(np.maximum(1e6 * values, LEAST), edges)
        axes.stairs(
            np.where(counts > 0, counts, np.nan),
            edges,
            label=name,
            linewidth=0.9,
            color=LINES[number % len(LINES)]["color"],
        )
    axes.axvline(1e6 * period, **LIMIT)
    axes.annotate("period", (1e6 * period, 1.0), xycoords=("data", "axes fraction"), ha="right", va="top", rotation=90)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("time [µs]")
    axes.set_ylabel("ticks")
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
