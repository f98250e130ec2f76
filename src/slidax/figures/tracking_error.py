"""The error inside its envelope."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax._types import Envelope
from slidax.simulation import Run

from .axes import use_size_axis, use_time_axis
from .logged import joint_label, log_of
from .style import BAND, BOUND, LINES, NARROW, ROW, WIDTH, envelope_patch, legend_above, styled
from .thinning import every_nth, thinned


@styled
def tracking_error(run: Run, *, window: tuple[float, float] | None = None) -> Figure:
    """Per joint: the error in its envelope, eq. (12), and to the right the error's size on a logarithmic axis.

    - `run`: with a log.
    - `window`: start and end [s]; by default the whole run.

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
        plain.plot(*thinned(t, e[:, i]), **LINES[0])
        plain.set_ylabel(joint_label(run, i, "e_{%d}", unit))
        logarithmic.plot(*thinned(t, np.abs(e[:, i])), **{**LINES[0], "linewidth": 0.9})
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
