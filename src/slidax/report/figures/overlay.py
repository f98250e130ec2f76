"""Errors of all joints in one panel, each as a share of its envelope bound."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from slidax.analysis.metric import short_names
from slidax.analysis.run_verdict import bound_shares
from slidax.core.errors import DefinitionError
from slidax.simulation.run import Run

from .style import BAND, BOUND, LINES, SMALL, log_of, styled, thin_curve, use_time_axis

HIGHEST = 250.0
"""Largest end of the axis [%]; a curve that is higher leaves the panel."""


@styled
def envelope_share(run: Run, *, ax: Axes | None = None) -> Figure:
    """Error of each joint as a share of its bound at that time: 100 % is the envelope. The joint nearest to it is blue.

    - `run`: run with a log and an envelope.
    - `ax`: axes to draw into; by default a new figure.

    Raises DefinitionError if the run has no log, or its scheme has no envelope.
    """
    log = log_of(run)
    if log.envelope is None:
        raise DefinitionError(
            "errors cannot be drawn as shares of an envelope that this run lacks: draw `tracking_error` instead"
        )
    t = np.asarray(log.t)
    shares = 100.0 * bound_shares(run)
    names = short_names(run.joint_names)
    worst, nearest = (int(k) for k in np.unravel_index(np.nanargmax(shares), shares.shape))
    figure = Figure(figsize=(SMALL, 2.3), layout="constrained") if ax is None else None
    axes: Axes = figure.subplots() if figure is not None else ax  # type: ignore[assignment]
    high = min(HIGHEST, max(112.0, 1.1 * float(np.nanmax(shares))))
    axes.axhspan(0.0, 100.0, **BAND)
    axes.axhline(100.0, **{**BOUND, "linewidth": 1.2})
    for joint in [k for k in range(run.joints) if k != nearest] + [nearest]:
        look = {**LINES[0], "linewidth": 1.5} if joint == nearest else {"color": "0.5", "linewidth": 0.8}
        axes.plot(*thin_curve(t, shares[:, joint]), **look, label=names[joint])
    axes.set_ylim(0.0, high)
    axes.set_ylabel("error / bound  [%]")
    use_time_axis(axes, float(t[0]), float(t[-1]))
    axes.text(float(t[-1]), 101.0, "envelope ", ha="right", va="bottom", color=BOUND["color"], fontsize=8.0)
    height = float(min(shares[worst, nearest], high))
    side = ("left", 6) if t[worst] < 0.7 * t[-1] else ("right", -6)
    share = shares[worst, nearest]
    size = f"{share:.3g} %" if share < 1000.0 else f"{share / 100.0:.3g} times its bound"
    axes.annotate(
        f"{names[nearest]}: {size} at {t[worst]:.3g} s",
        (float(t[worst]), height),
        xytext=(side[1], 2),
        textcoords="offset points",
        ha=side[0],
        va="bottom",
        color=LINES[0]["color"],
    )
    return axes.figure  # type: ignore[return-value]
