"""What stands beside the arm while it plays: one joint's error in its envelope, and its torque within its limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from slidax.figures.logged import log_of
from slidax.figures.style import BOUND, LINES
from slidax.figures.thinning import thinned

from .drawing import Drawing
from .motion import sound_samples

INSIDE = "rgba(0, 114, 178, 0.09)"
"""The colour of what is allowed."""


class Chart:
    """A quantity over time, with its bounds and a line at the time that is shown.

    - `server`: where it is shown.
    - `t`: times [k], s.
    - `value`: [k].
    - `bounds`: below and above [k] each, or None.
    - `label`: of the quantity.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        t: np.ndarray,
        value: np.ndarray,
        bounds: tuple[np.ndarray, np.ndarray] | None,
        label: str,
    ) -> None:
        self._curves = _few(t, value, bounds)
        drawn = self._curves[1:]
        low = min(float(curve.min()) for curve in drawn)
        high = max(float(curve.max()) for curve in drawn)
        margin = 0.05 * (high - low) or 1e-9
        self._range = (low - margin, high + margin)
        names = [label, "lower", "upper"][: len(drawn)]
        styles: list[Any] = [{"stroke": LINES[0]["color"], "width": 1.5}]
        styles += [{"stroke": BOUND["color"], "width": 1.0}] * (len(drawn) - 1)
        none: Any = {"show": False}
        thin: Any = {"grid": {"stroke": "#eceef1", "width": 1}, "ticks": {"width": 1, "size": 4, "stroke": "#b8bec6"}}
        curves: list[Any] = [
            {"label": name, "points": none, **style} for name, style in zip(names, styles, strict=True)
        ]
        now: Any = {"label": "now", "stroke": "#222222", "width": 1.0, "points": none}
        self._chart = server.gui.add_uplot(
            self._data(float(t[0])),
            ({"label": "t"}, *curves, now),
            title=label,
            bands=({"series": (3, 2), "fill": INSIDE},) if bounds is not None else None,
            scales={"x": {"time": False, "range": (float(t[0]), float(t[-1]))}, "y": {"range": self._range}},
            axes=(thin | {"size": 28}, thin | {"size": 58}),
            legend={"show": False},
            height=190,
            padding=(4, 12, 0, 0),
        )

    def show(self, t: float) -> None:
        """Draws the line at a time.

        - `t`: s.
        """
        self._chart.data = self._data(t)

    def remove(self) -> None:
        """Takes the chart away."""
        self._chart.remove()

    def _data(self, now: float) -> tuple[np.ndarray, ...]:
        """All curves need one axis, so the upright line is a curve with two places of its own on it, and none else."""
        times = self._curves[0]
        at = int(np.searchsorted(times, now))
        places = np.insert(times, at, [now, now])
        curves = [np.insert(curve, at, [np.interp(now, times, curve)] * 2) for curve in self._curves[1:]]
        line = np.full(len(places), np.nan)
        line[at : at + 2] = self._range
        return (places, *curves, line)


def joint_charts(server: viser.ViserServer, drawing: Drawing, joint: int) -> list[Chart]:
    """The charts of one joint.

    - `server`: where they are shown.
    - `drawing`: what is shown.
    - `joint`: its number, from 0.
    """
    log = log_of(drawing.run)
    unit = drawing.run.joint_units[joint]
    error, tau = np.asarray(log.e)[:, joint], np.asarray(log.tau)[:, joint]
    good = sound_samples(log)
    t = np.asarray(log.t)[good]
    envelope = None
    if log.envelope is not None:
        lower, upper = np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
        envelope = (lower[good, joint], upper[good, joint])
    limit = drawing.torque_limits[joint]
    limits = (np.full(len(t), -limit), np.full(len(t), limit)) if np.isfinite(limit) else None
    return [
        Chart(server, t, error[good], envelope, f"error [{unit}]"),
        Chart(server, t, tau[good], limits, f"torque [{drawing.run.torque_units[joint]}]"),
    ]


def _few(t: np.ndarray, value: np.ndarray, bounds: tuple[np.ndarray, np.ndarray] | None) -> list[np.ndarray]:
    """Time, value and bounds at the few times that show every peak of the value: they are sent anew as time passes."""
    times, _ = thinned(t, value, columns=120)
    at = np.searchsorted(t, times)
    return [curve[at].astype(float) for curve in (t, value, *(bounds or ()))]
