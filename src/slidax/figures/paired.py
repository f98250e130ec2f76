"""Errors of several runs, at the beginning and as sizes over the whole run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from slidax.simulation import Run

from .axes import use_size_axis, use_time_axis
from .logged import joint_label
from .overlay import clipped, columns_for, crest, legend_rows, linear_range, traces_of, zero_line
from .style import ROW, WIDTH
from .thinning import thinned


def draw_pairs(
    runs: Mapping[str, Run], field: str, symbol: str, rate: str, beginning: float
) -> tuple[Figure, np.ndarray]:
    """The figure and its panels [n 2]: to the left on a linear, to the right on a logarithmic axis.

    - `runs`: of the same arm, with logs, by name.
    - `field`: quantity of the log: `e` or `de`.
    - `symbol`: mathematical text with `%d` for the joint's number.
    - `rate`: suffix of the joint's unit: empty or `/s`.
    - `beginning`: [s].

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
    # A run that diverges must not set the axis for the others: it may leave it at the top.
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
            plain.plot(*thinned(c.t[start], clipped(c.y[start, i], limits), few, limits), **look)
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
    x, y = thinned(t, np.log10(np.maximum(size, limits[0] / 10.0)), len(t), (float(low), float(high)))
    return x, 10.0**y
