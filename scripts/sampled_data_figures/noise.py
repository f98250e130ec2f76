"""What the noise of encoders costs, by horizon and estimator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax import metrics
from slidax.figures.style import LINES, WIDTH, legend_above, styled

from .labels import Label, place
from .loops import (
    loop,
    milliseconds,
    plain_numbers,
    save,
    small,
    steady_error,
    steady_step,
    steady_step_rms,
    table,
    write_table,
)

SCENARIO = "example-4.1-1khz"
ENCODERS = {"sensor.resolution": 1e-5, "sensor.velocity": "differenced"}
HORIZONS = (0.003, 0.005, 0.008, 0.012, 0.016, 0.02)
RADII = (0.002, 0.01)
USUAL = ("kalman", 0.05, 0.012)
LARGEST_STEP, LARGEST_RMS = 0.5, 0.1

ESTIMATORS: dict[str, tuple[str, str, str, tuple[float, ...]]] = {
    "kalman": ("Kalman filter, by torque density", "torque_density", "(N m/s)² s", (0.001, 0.01, 0.05, 0.25, 1.0)),
    "robust_differentiator": ("robust differentiator, by $L$", "lipschitz", "rad/s³", (1.0, 3.0, 10.0, 30.0)),
    "filtered_difference": ("filtered difference, by cutoff", "cutoff", "rad/s", (20.0, 50.0, 100.0, 200.0)),
}
"""By kind: its name, its parameter, the unit and the values of it."""


@dataclass(frozen=True)
class Point:
    """One run.

    - `error`: steady error [rad].
    - `rms`, `step`: steady torque step, root mean square and largest [N m].
    - `violations`: samples outside the envelope.
    """

    error: float
    rms: float
    step: float
    violations: int


def _point(changes: dict[str, Any], period: float = 1e-3) -> Point:
    run = loop(SCENARIO, period, ENCODERS | changes).simulate(log_every=None)
    return Point(steady_error(run), steady_step_rms(run), steady_step(run), metrics.envelope_violations(run) or 0)


def _estimator(kind: str, value: float, horizon: float, radius: float) -> Point:
    return _point(
        {
            "scheme.sampled_data.estimator": {"kind": kind, ESTIMATORS[kind][1]: value},
            "scheme.sampled_data.horizon": horizon,
            "scheme.performance.final": radius,
        }
    )


def _draw(axes: Axes, points: dict[tuple[str, float, float], Point]) -> list[Label]:
    """The curves of a panel; their labels are placed once it is laid out."""
    labels: list[Label] = []
    for (kind, (*_, values)), look in zip(ESTIMATORS.items(), LINES, strict=False):
        color, all_kept = look["color"], []
        for value in values:
            kept = [p for p in (points[kind, value, horizon] for horizon in HORIZONS) if p.violations == 0]
            all_kept += kept
            x, y = [p.rms for p in kept], [1e6 * p.error for p in kept]
            axes.plot(x, y, color=color, linewidth=0.7)
            if kept:
                labels.append(Label(f"{value:g}", [(x[-1], y[-1]), (x[0], y[0])], color))
        for calm, fill in ((True, color), (False, "white")):
            shown = [p for p in all_kept if (p.step <= LARGEST_STEP) == calm]
            axes.plot(
                [p.rms for p in shown], [1e6 * p.error for p in shown], "o",
                color=color, markerfacecolor=fill, markersize=3.2, markeredgewidth=0.7,
            )  # fmt: skip
    usual = points[USUAL]
    axes.plot(usual.rms, 1e6 * usual.error, "*", color="black", markersize=9, zorder=4)
    axes.axvline(LARGEST_RMS, color="0.45", linewidth=0.7, linestyle=(0, (3, 2)))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(0.01, 4)
    axes.set_ylim(5, 250)
    plain_numbers(axes, (0.01, 0.1, 1), (5, 10, 20, 50, 100, 200))
    axes.set_xlabel("torque step, rms  [N m]")
    return labels


@styled
def draw(points: dict[float, dict[tuple[str, float, float], Point]]) -> Figure:
    """The picture: steady error over the torque's restlessness, a panel for each final radius.

    - `points`: by final radius, then by kind, parameter and horizon.
    """
    figure = Figure(figsize=(WIDTH, 3.5), layout="constrained")
    panels = figure.subplots(1, len(points), sharey=True)
    labels = []
    for axes, (radius, found) in zip(panels, points.items(), strict=True):
        labels.append(_draw(axes, found))
        axes.set_title(rf"$\rho_\infty$ = {1e3 * radius:g} mrad")
    panels[0].set_ylabel("steady error  [µrad]")
    handles = [
        Line2D([], [], **{**look, "linestyle": "-"}, label=f"{name} [{unit}]")
        for (name, _, unit, _), look in zip(ESTIMATORS.values(), LINES, strict=False)
    ]
    grey: dict[str, Any] = {"marker": "o", "linestyle": "", "color": "0.3", "markersize": 3.2}
    handles += [
        Line2D([], [], **grey, label=f"largest torque step up to {LARGEST_STEP:g} N m"),
        Line2D([], [], **{**grey, "markerfacecolor": "white"}, label="larger steps"),
        Line2D([], [], marker="*", linestyle="", color="black", markersize=8, label="the default"),
    ]
    legend_above(figure, handles, 2)
    figure.draw_without_rendering()
    for axes, named in zip(panels, labels, strict=True):
        place(axes, named)
    return figure


def make() -> None:
    """Measures, and writes the figure and its table."""
    points = {
        radius: {
            (kind, value, horizon): _estimator(kind, value, horizon, radius)
            for kind, (*_, values) in ESTIMATORS.items()
            for value in values
            for horizon in HORIZONS
        }
        for radius in RADII
    }
    save(draw(points), "noise-trade-off")

    def row(name: str, value: str, horizon: float, p: Point) -> list[str]:
        cells = [milliseconds(horizon), small(p.error), f"{p.rms:.2g}", f"{p.step:.2g}", str(p.violations)]
        return [f"{name} {value}", *cells]

    first = points[RADII[0]]
    picked = [("kalman", 0.05, horizon) for horizon in HORIZONS]
    picked += [("kalman", value, 0.012) for value in (0.001, 0.01, 0.25, 1.0)]
    picked += [("robust_differentiator", value, h) for value, h in ((1.0, 0.012), (3.0, 0.012), (3.0, 0.02))]
    picked += [("filtered_difference", value, h) for value, h in ((50.0, 0.012), (20.0, 0.02), (100.0, 0.02))]
    rows = [row(f"`{kind}`", f"{value:g} {ESTIMATORS[kind][2]}", h, first[kind, value, h]) for kind, value, h in picked]
    naive = {"scheme.sampled_data.estimator": {"kind": "measured", "gain": 0.1}}
    rows.append(row("`measured`", "gain .1", 0.012, _point(naive)))
    blind = {"scheme.sampled_data.estimator": {"kind": "measured", "gain": 0.0, "trend": 0.0}}
    rows.append(row("`measured`", "gain 0", 0.012, _point(blind)))
    head = ["estimator", "H [ms]", "steady error [rad]", "torque step, rms [N m]", "largest [N m]", "samples outside"]
    write_table("loop-rate.md", "noise", table(head, rows))
    if any(math.isnan(p.error) for p in first.values()):
        print("noise-trade-off: some runs did not reach their end")
