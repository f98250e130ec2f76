"""Live charts of one joint: its error in the envelope, and its torque within the limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from slidax.figures.logged import log_of
from slidax.figures.style import BOUND, LINES
from slidax.figures.thinning import thinned

from .drawing import Drawing
from .motion import valid_samples

ALLOWED = "rgba(0, 114, 178, 0.09)"
"""Fill colour between the bounds."""

HIDDEN: Any = {"show": False}
THIN: Any = {"grid": {"stroke": "#eceef1", "width": 1}, "ticks": {"width": 1, "size": 4, "stroke": "#b8bec6"}}


class Chart:
    """A quantity over time with its bounds, and a vertical line at the displayed time.

    - `server`: displays the chart.
    - `t`, `value`: times [k], s, and values [k].
    - `bounds`: lower and upper [k] each, or None.
    - `label`: of the quantity, with its unit.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        t: np.ndarray,
        value: np.ndarray,
        bounds: tuple[np.ndarray, np.ndarray] | None,
        label: str,
    ) -> None:
        # The curves are sent anew as time passes, so few points; every peak of the value is among them.
        times, _ = thinned(t, value, columns=120)
        chosen = np.searchsorted(t, times)
        self._curves = [curve[chosen].astype(float) for curve in (t, value, *(bounds or ()))]
        low = min(float(curve.min()) for curve in self._curves[1:])
        high = max(float(curve.max()) for curve in self._curves[1:])
        margin = 0.05 * (high - low) or 1e-9
        self._range = (low - margin, high + margin)
        series: list[Any] = [{"label": label, "points": HIDDEN, "stroke": LINES[0]["color"], "width": 1.5}]
        for name in ("lower", "upper")[: len(self._curves) - 2]:
            series.append({"label": name, "points": HIDDEN, "stroke": BOUND["color"], "width": 1.0})
        series.append({"label": "now", "points": HIDDEN, "stroke": "#222222", "width": 1.0})
        self._chart = server.gui.add_uplot(
            self._data(float(t[0])),
            ({"label": "t"}, *series),
            title=label,
            bands=({"series": (3, 2), "fill": ALLOWED},) if bounds is not None else None,
            scales={"x": {"time": False, "range": (float(t[0]), float(t[-1]))}, "y": {"range": self._range}},
            axes=(THIN | {"size": 28}, THIN | {"size": 58}),
            legend={"show": False},
            height=190,
            padding=(4, 12, 0, 0),
        )

    def show(self, t: float) -> None:
        """Move the vertical line to time `t` [s]."""
        self._chart.data = self._data(t)

    def remove(self) -> None:
        """Remove the chart from the page."""
        self._chart.remove()

    def _data(self, now: float) -> tuple[np.ndarray, ...]:
        """All curves share one axis, so the vertical line is a curve with two points of its own on it."""
        times = self._curves[0]
        index = int(np.searchsorted(times, now))
        axis = np.insert(times, index, [now, now])
        curves = [np.insert(curve, index, [np.interp(now, times, curve)] * 2) for curve in self._curves[1:]]
        line = np.full(len(axis), np.nan)
        line[index : index + 2] = self._range
        return (axis, *curves, line)


def joint_charts(server: viser.ViserServer, drawing: Drawing, joint: int) -> list[Chart]:
    """Add the charts of one joint to the page.

    - `server`, `drawing`: the page and its content.
    - `joint`: index from 0.
    """
    log = log_of(drawing.run)
    valid = valid_samples(log)
    t, error, tau = (np.asarray(values)[valid] for values in (log.t, log.e[:, joint], log.tau[:, joint]))
    envelope = None
    if log.envelope is not None:
        lower, upper = np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
        envelope = (lower[valid, joint], upper[valid, joint])
    limit = drawing.torque_limits[joint]
    limits = (np.full(len(t), -limit), np.full(len(t), limit)) if np.isfinite(limit) else None
    return [
        Chart(server, t, error, envelope, f"error [{drawing.run.joint_units[joint]}]"),
        Chart(server, t, tau, limits, f"torque [{drawing.run.torque_units[joint]}]"),
    ]
