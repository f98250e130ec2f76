"""Certified bounds of the error in the prescribed envelope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .axes import use_size_axis, use_time_axis
from .style import BAND, BOUND, LINES, NARROW, WIDTH, envelope_patch, legend_above, styled
from .thinning import every_nth

COLUMNS = 3


@styled
def bounded_error(
    t: np.ndarray,
    radii: np.ndarray,
    bounds: Mapping[str, tuple[np.ndarray, np.ndarray]],
    names: Sequence[str],
    units: Sequence[str],
) -> Figure:
    """Per joint: both sides of the envelope by their distance from zero, and bounds of |e|, on a logarithmic axis.

    - `t`: times [N], s.
    - `radii`: of the narrower and the wider side [2 N n], rad or m.
    - `bounds`: of |e| by name: times [k], s, and bounds [k n].
    - `names`, `units`: of the joints.
    """
    joints = radii.shape[2]
    columns = min(COLUMNS, joints)
    rows = -(-joints // columns)
    figure = Figure(figsize=(WIDTH, 1.9 * rows + 0.4), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True)
    sizes = np.concatenate([radii.ravel(), *(size.ravel() for _, size in bounds.values())])
    # The axis leaves out what is rarely so small, and a bound is drawn for a part of the time only.
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
        axes.set_ylabel(f"{names[joint]}: $|e|$  [{units[joint]}]")
    for axes in panels.ravel()[joints:]:
        axes.set_visible(False)
    legend_above(figure, handles)
    return figure
