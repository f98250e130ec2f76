"""What stands beside the arm in a recording: a picture of each joint, and where in it each time is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from slidax.figures.axes import use_size_axis, use_time_axis
from slidax.figures.logged import log_of
from slidax.figures.style import BAND, BOUND, LINES, styled
from slidax.figures.thinning import every_nth, thinned

from .drawing import Drawing
from .motion import sound_samples


@dataclass(frozen=True)
class Curves:
    """A picture over time.

    - `figure`: it.
    - `left`, `right`: where its first and last time are, as shares of its width.
    - `panels`: from where to where each of its panels goes, as shares of its height from above.
    """

    figure: Figure
    left: float
    right: float
    panels: list[tuple[float, float]]


@styled
def joint_curves(drawing: Drawing, joint: int) -> Curves:
    """One joint: its error in its envelope, the error's size, its torque within its limits.

    - `drawing`: of the run.
    - `joint`: number of the joint, from 0.
    """
    figure = Figure(figsize=(3.9, 5.0))
    panels = figure.subplots(3, 1, sharex=True)
    figure.subplots_adjust(left=0.165, right=0.965, top=0.985, bottom=0.085, hspace=0.12)
    t, error, tau, bounds = _samples(drawing, joint)
    unit = drawing.run.joint_units[joint]
    plain, size, torque = panels
    _draw_error(plain, t, error, bounds)
    plain.set_ylabel(f"error  [{unit}]")
    sizes = np.abs(error) if bounds is None else np.append(np.abs(error), np.abs(bounds).max())
    use_size_axis([size], sizes)
    if bounds is not None:
        narrow, wide = np.sort(np.abs(bounds), axis=0)
        _fill(size, t, np.full(len(t), size.get_ylim()[0]), wide)
        size.plot(every_nth(t), every_nth(narrow), **{**BOUND, "linewidth": 0.6, "linestyle": (0, (4, 2))})
    size.plot(*thinned(t, np.abs(error)), **{**LINES[0], "linewidth": 0.9})
    size.set_ylabel(f"its size  [{unit}]")
    limit = drawing.torque_limits[joint]
    if np.isfinite(limit):
        _fill(torque, t, np.full(len(t), -limit), np.full(len(t), limit))
    torque.plot(*thinned(t, tau), **LINES[0])
    torque.set_ylabel(f"torque  [{drawing.run.torque_units[joint]}]")
    torque.margins(y=0.06)
    return _placed(figure, list(panels), t)


@styled
def error_curves(drawing: Drawing, width: float, height: float) -> Curves:
    """All joints: their errors in their envelopes.

    - `drawing`: of the run.
    - `width`, `height`: of the picture, in.
    """
    figure = Figure(figsize=(width, height))
    joints = drawing.skeleton.joints
    panels = figure.subplots(joints, 1, sharex=True, squeeze=False)[:, 0]
    figure.subplots_adjust(left=0.2, right=0.96, top=0.975, bottom=0.08, hspace=0.18)
    for joint, axes in enumerate(panels):
        t, error, _, bounds = _samples(drawing, joint)
        _draw_error(axes, t, error, bounds)
        axes.set_ylabel(rf"$e_{{{joint + 1}}}$  [{drawing.run.joint_units[joint]}]")
        axes.yaxis.set_major_locator(MaxNLocator(nbins=max(2, 9 // joints + 1)))
    return _placed(figure, list(panels), t)


def _samples(drawing: Drawing, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Time, error, torque and bounds, of the samples that can be shown."""
    log = log_of(drawing.run)
    error, tau = np.asarray(log.e)[:, joint], np.asarray(log.tau)[:, joint]
    good = sound_samples(log)
    bounds = None
    if log.envelope is not None:
        bounds = np.stack([np.asarray(edge)[good, joint] for edge in (log.envelope.lower, log.envelope.upper)])
    return np.asarray(log.t)[good], error[good], tau[good], bounds


def _draw_error(axes: Axes, t: np.ndarray, error: np.ndarray, bounds: np.ndarray | None) -> None:
    if bounds is not None:
        _fill(axes, t, *bounds)
    axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=1.5)
    axes.plot(*thinned(t, error), **LINES[0])
    axes.margins(y=0.06)


def _fill(axes: Axes, t: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    time, low, high = every_nth(t), every_nth(lower), every_nth(upper)
    axes.fill_between(time, low, high, **BAND)
    edges: Any = (low, high)
    for edge in edges:
        axes.plot(time, edge, **BOUND)


def _placed(figure: Figure, panels: list[Axes], t: np.ndarray) -> Curves:
    use_time_axis(panels[-1], float(t[0]), float(t[-1]))
    panels[0].set_xlim(float(t[0]), float(t[-1]))
    figure.align_ylabels()
    boxes = [axes.get_position() for axes in panels]
    return Curves(figure, boxes[0].x0, boxes[0].x1, [(1 - box.y1, 1 - box.y0) for box in boxes])
