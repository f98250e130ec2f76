"""Figures and tables of docs/sampled-data.md, and of noise in docs/loop-rate.md."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from slidax import analysis, scenarios
from slidax.report.figures.compared import crest
from slidax.report.figures.style import (
    BAND,
    BOUND,
    LINES,
    NARROW,
    WIDTH,
    envelope_patch,
    every_nth,
    legend_above,
    styled,
    thin_curve,
    use_size_axis,
    use_time_axis,
)
from slidax.simulation import Run

from .shared import (
    BARE,
    loop,
    milliseconds,
    order,
    plain_numbers,
    save,
    small,
    smallest,
    steady_error,
    steady_step,
    steady_step_rms,
    table,
    write_table,
)

ONE_KILOHERTZ_SCENARIO = "example-4.1-1khz"
COLUMNS = 160
TITLES = ("the law as printed", "the sampled-data law")


def _crest(run: Run, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """The error's size, as the largest of each column of the picture."""
    columns = round(COLUMNS * float(run.log.t[-1]) / float(run.t1))
    return crest(np.asarray(run.log.t), np.abs(np.asarray(run.log.e)[:, joint]), columns)


def _draw_size(axes: Axes, run: Run, whole: Run, joint: int) -> None:
    t, bounds = np.asarray(whole.log.t), whole.log.envelope
    sides = np.sort(np.abs([np.asarray(bounds.lower)[:, joint], np.asarray(bounds.upper)[:, joint]]), axis=0)
    narrow, wide = (every_nth(side, 60) for side in sides)
    time = every_nth(t, 60)
    axes.fill_between(time, axes.get_ylim()[0], wide, **BAND)
    axes.plot(time, wide, **BOUND)
    axes.plot(time, narrow, **NARROW)
    axes.plot(*_crest(run, joint), **{**LINES[0], "linewidth": 1.0})


@styled
def draw_one_kilohertz(printed: Run, sampled: Run) -> Figure:
    """The picture: sizes of the errors in their envelopes and the torques, the printed law to the left.

    - `printed`: a run that ends where it leaves the envelope.
    """
    figure = Figure(figsize=(WIDTH, 4.3), layout="constrained")
    panels = figure.subplots(3, 2, sharex=True, sharey="row")
    use_size_axis(panels[:2].ravel(), np.concatenate([_crest(sampled, joint)[1] for joint in (0, 1)]))
    for column, run in enumerate((printed, sampled)):
        for joint in (0, 1):
            _draw_size(panels[joint, column], run, sampled, joint)
        torque = panels[2, column]
        for joint, look in enumerate(LINES[:2]):
            points = thin_curve(np.asarray(run.log.t), np.asarray(run.log.tau)[:, joint], 60)
            torque.plot(*points, **{**look, "linewidth": 0.8, "linestyle": "-", "alpha": 0.9})
        panels[0, column].set_title(TITLES[column])
    outcome = printed.outcome
    for axes in panels[:, 0]:
        axes.axvspan(outcome.t, float(sampled.t1), facecolor="1", edgecolor="none", alpha=0.72, zorder=3)
        axes.axvline(outcome.t, color="0.2", linewidth=0.8, zorder=3.5)
    over = panels[outcome.joint - 1, 0]
    over.plot(outcome.t, abs(outcome.error), "o", color="#C00000", markersize=4.5, zorder=4)
    over.annotate(
        f"joint {outcome.joint} leaves its\nenvelope at {outcome.t:.2f} s",
        (outcome.t, abs(outcome.error)), (10, -10), textcoords="offset points", color="#C00000", va="top", zorder=5,
    )  # fmt: skip
    panels[2, 0].annotate("the run is over", (outcome.t, 0), (10, 0), textcoords="offset points", va="center", zorder=5)
    for joint in (0, 1):
        panels[joint, 0].set_ylabel(rf"$|e_{{{joint + 1}}}|$  [rad]")
    panels[2, 0].set_ylabel(r"$\tau$  [N m]")
    panels[2, 0].set_ylim(-68, 68)
    for axes in panels[2]:
        use_time_axis(axes, 0.0, float(sampled.t1))
    for axes in panels[:2].ravel():
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set_yticks([1e-6, 1e-4, 1e-2, 1.0])
    figure.align_ylabels()
    legend_above(
        figure,
        [
            Line2D([], [], **LINES[0], label="error"),
            envelope_patch(),
            Line2D([], [], **NARROW, label="its narrower side"),
            Line2D([], [], **{**LINES[0], "linestyle": "-"}, label="torque of joint 1"),
            Line2D([], [], **{**LINES[1], "linestyle": "-"}, label="of joint 2"),
        ],
    )
    return figure


def write_one_kilohertz() -> None:
    """Simulate the printed law and its sampled-data form at 1 kHz, and draw both."""
    as_printed = {"scheme.sampled_data": None, "scheme.reaching.layer": 0.05, "simulation.outside": "raise"}
    printed = scenarios.load(ONE_KILOHERTZ_SCENARIO, as_printed).simulate(log_every=1)
    sampled = scenarios.load(ONE_KILOHERTZ_SCENARIO).simulate(log_every=1)
    save(draw_one_kilohertz(printed, sampled), "one-kilohertz")


CONVERGENCE_SCENARIO = "example-4.1"
# Not 2.5, 5 or 10 ms, at which samples meet the 100 Hz of the disturbance always in the same phase.
PERIODS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 4e-4, 7e-4, 1e-3, 1.5e-3, 2.2e-3, 3.1e-3, 4.3e-3, 6.1e-3, 8.3e-3, 1.1e-2)
PRINTED = (1e-5, 2e-5, 5e-5, 1e-4, 1.4e-4, 1.5e-4, 1.6e-4, 2e-4, 3e-4, 4e-4, 5e-4, 7e-4, 1e-3)
NEAR = (2e-5, 1e-4, 4e-4, 1e-3, 2e-3)
SHOWN = (1e-5, 1e-4, 4e-4, 1e-3, 2.2e-3, 4.3e-3, 1.1e-2)
LAWS = {
    "implicit, $H = h$, $s_0 = 0.05$": ({**BARE, "scheme.reaching.layer": 0.05}, True),
    "implicit, $H = h$, $s_0 = 0$": ({**BARE, "scheme.reaching.layer": 0.0}, True),
    "with estimate, $H = 12$ ms, $s_0 = 0$": (
        {"scheme.sampled_data": {"recovery": None}, "scheme.reaching.layer": 0.0},
        False,
    ),
}
AS_PRINTED = "as printed, $s_0 = 0.05$"
NAMES = (
    "as printed, s0 = 0.05",
    "implicit, H = h, s0 = 0.05",
    "implicit, H = h, s0 = 0",
    "with estimate, H = 12 ms, s0 = 0",
)


def _error(period: float, changes: dict[str, Any], follows: bool) -> float:
    horizon = {"scheme.sampled_data.horizon": period} if follows else {}
    return steady_error(loop(CONVERGENCE_SCENARIO, period, changes | horizon).simulate(log_every=None))


def limit_of_hold() -> tuple[float, float, float]:
    """The predicted period of the limit cycle, that of the boundary layer, and the observed one [s]."""
    law = scenarios.load(CONVERGENCE_SCENARIO).controller
    surface, ratio = law.surface, law.transformation
    slope = float(surface.phi_and_slope(jnp.zeros(2))[1][0])
    rate = slope * float((1.0 / ratio.overshoot + 1.0) / ratio.performance.final[0])
    scenario = scenarios.load(CONVERGENCE_SCENARIO)
    goal = scenario.trajectory.reference(jnp.asarray(10.0)).q
    true, nominal = scenario.plant.robot.mass(goal), law.nominal.mass(goal)
    share = float(np.max(np.real(np.linalg.eigvals(np.linalg.solve(true, nominal)))))
    run = loop(CONVERGENCE_SCENARIO, 1e-4).simulate(log_every=1)
    u = float(run.log.signals["u"][-1])
    layer = 2.0 * float(law.reaching.layer) * float(np.linalg.eigvalsh(true)[0]) / u
    smooth = steady_step(run) / 1e-4

    def cycles(h: float) -> bool:
        # The same number of samples for all, so that the loop is compiled once.
        return (
            not steady_step(loop(CONVERGENCE_SCENARIO, h, t1=70_000 * h).simulate(log_every=None)) < 20.0 * smooth * h
        )

    return 2.0 / (share * rate), layer, smallest(cycles, 1.3e-4, 1.7e-4, 6)


def distance_to_printed() -> list[float]:
    """By how much the implicit law's errors differ from the printed law's within 2 s, for each period of NEAR [rad]."""
    every = 2e-3
    fine = scenarios.load(CONVERGENCE_SCENARIO, {"simulation.period": 1e-5, "simulation.t1": 2.0})
    printed = np.asarray(fine.simulate(log_every=round(every / 1e-5)).log.e)
    distances = []
    for h in NEAR:
        changes = {**BARE, "scheme.sampled_data.horizon": h}
        run = loop(CONVERGENCE_SCENARIO, h, changes, t1=2.0).simulate(log_every=round(every / h))
        distances.append(float(np.max(np.abs(np.asarray(run.log.e) - printed))))
    return distances


@styled
def draw_convergence(
    printed: list[float], errors: dict[str, list[float]], distances: list[float], predicted: float, observed: float
) -> Figure:
    """The picture: to the left steady errors over the period, to the right the distance to the printed law.

    - `printed`: steady errors of the printed law, for PRINTED.
    - `errors`: of the others by name, for PERIODS.
    - `predicted`, `observed`: period at which the limit cycle begins [s].
    """
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.75, 1])
    inside = [(1e3 * h, e) for h, e in zip(PRINTED, printed, strict=True) if not math.isnan(e)]
    handles = left.plot(*zip(*inside, strict=True), **LINES[1], marker="o", markersize=2.2, label=AS_PRINTED)
    left.plot(*inside[-1], marker="x", color=LINES[1]["color"], markersize=6, markeredgewidth=1.3)
    left.annotate(
        "leaves the\nenvelope", inside[-1], (7, 1), textcoords="offset points", va="center", color=LINES[1]["color"]
    )
    looks = (LINES[0], LINES[2], LINES[3])
    for (name, values), look in zip(errors.items(), looks, strict=True):
        handles += left.plot([1e3 * h for h in PERIODS], values, **look, marker="o", markersize=2.2, label=name)
    left.axvline(1e3 * predicted, color="0.45", linewidth=0.7, linestyle=(0, (3, 2)))
    left.annotate(
        f"limit cycle:\npredicted {1e3 * predicted:.3f} ms\nobserved {1e3 * observed:.3f} ms",
        (1e3 * predicted, 6e-6), (-5, 0), textcoords="offset points", ha="right", va="center", fontsize=8,
    )  # fmt: skip
    left.set_ylabel("steady error  [rad]")
    left.set_ylim(1e-10, 2e-3)
    right.plot([1e3 * h for h in NEAR], distances, **LINES[0], marker="o", markersize=2.2)
    start = 0.45 * distances[0]
    right.plot([1e-2, 2.0], [start, 200 * start], color="0.45", linewidth=0.7)
    right.annotate("order 1", (0.14, 14 * start), (3, -9), textcoords="offset points", fontsize=8)
    right.set_ylabel("distance to the printed law  [rad]")
    for axes, ticks in ((left, (0.01, 0.1, 1, 10)), (right, (0.01, 0.1, 1))):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("$h$  [ms]")
        plain_numbers(axes, ticks)
    left.set_xlim(0.8e-2, 15)
    right.set_xlim(0.8e-2, 2.6)
    legend_above(figure, handles, 2)
    return figure


def write_convergence() -> None:
    """Measure, and write the figure and its tables."""
    printed = [steady_error(loop(CONVERGENCE_SCENARIO, h).simulate(log_every=None)) for h in PRINTED]
    # All laws at one period after each other: they share what is compiled.
    values = [[_error(h, changes, follows) for changes, follows in LAWS.values()] for h in PERIODS]
    errors = {name: [row[i] for row in values] for i, name in enumerate(LAWS)}
    predicted, layer, observed = limit_of_hold()
    distances = distance_to_printed()
    save(draw_convergence(printed, errors, distances, predicted, observed), "convergence")

    known = dict(zip(PRINTED, printed, strict=True))
    columns = list(errors.values())
    rows = [
        [milliseconds(h), "left" if math.isnan(known.get(h, math.nan)) else small(known[h])]
        + [small(column[PERIODS.index(h)]) for column in columns]
        for h in SHOWN
    ]
    ranges = ((1e-5, 1e-4), (4e-4, 2.2e-3), (3.1e-3, 1.1e-2))
    for low, high in ranges:
        orders = [f"{order(PERIODS, column, low, high):.1f}" for column in columns]
        rows.append([f"order, {milliseconds(low)} to {milliseconds(high)}", "-", *orders])
    write_table("sampled-data.md", "steady errors", table(["h [ms]", *NAMES], rows))

    rows = [[milliseconds(h), small(d)] for h, d in zip(NEAR, distances, strict=True)]
    rows.append(["order", f"{order(NEAR, distances, NEAR[0], NEAR[-1]):.2f}"])
    write_table("sampled-data.md", "distance", table(["h [ms]", "max abs(e - e of the printed law) [rad]"], rows))
    head = ["the printed law's period must be below", "[ms]"]
    rows = [
        ["`2/(λmax(M⁻¹M0) λ)`", f"{1e3 * predicted:.3f}"],
        ["`2 s0 λmin(M)/u`, the boundary layer's", f"{1e3 * layer:.1f}"],
        ["observed: steady torque steps grow by more than 20 times", f"{1e3 * observed:.3f}"],
    ]
    write_table("sampled-data.md", "limit", table(head, rows))


SIZE = 7.0
"""Font size [pt]."""


@dataclass(frozen=True)
class Label:
    """The name of a curve.

    - `text`: a few characters.
    - `places`: points of the curve, near any of which the label may be, in data coordinates.
    - `color`: of the curve.
    """

    text: str
    places: Sequence[tuple[float, float]]
    color: str


def place(axes: Axes, labels: Sequence[Label]) -> None:
    """Write each label where it covers the least of all lines, marks and other labels, and near its curve.

    - `axes`: with all that is drawn, and laid out.
    """
    scale = 72.0 / axes.figure.dpi
    drawn = np.concatenate([_points(line) * scale for line in axes.lines])
    low, high = (axes.transAxes.transform(corner) * scale for corner in ((0, 0), (1, 1)))
    taken: list[np.ndarray] = []
    for label in labels:
        half = np.array([0.27 * SIZE * len(label.text) + 1.0, 0.42 * SIZE + 1.0])
        best = None
        for rank, at in enumerate(label.places):
            start = axes.transData.transform(at) * scale
            for distance in (4.0, 7.0, 11.0, 15.0):
                for angle in np.arange(24) * np.pi / 12:
                    way = np.array([np.cos(angle), np.sin(angle)])
                    middle = start + way * (distance + np.abs(way) @ half)
                    covered = int((np.abs(drawn - middle) < half).all(axis=1).sum())
                    met = sum(bool((np.abs(other - middle) < 2 * half).all()) for other in taken)
                    off = bool((middle - half < low).any() or (middle + half > high).any())
                    cost = 10 * covered + 500 * (met + off) + distance + 2 * rank
                    if best is None or cost < best[0]:
                        best = (cost, at, middle, middle - start)
        if best is not None:
            _, at, middle, offset = best
            taken.append(middle)
            axes.annotate(
                label.text,
                at,
                tuple(offset),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=SIZE,
                color=label.color,
                in_layout=False,
            )


def _points(line: Line2D) -> np.ndarray:
    """Points about a pixel apart along a line, as they are on the picture."""
    corners = line.get_transform().transform(line.get_xydata())
    if len(corners) < 2 or line.get_linestyle() == "None":
        return corners
    steps = (np.linspace(first, last, 2 + int(np.hypot(*(last - first)))) for first, last in pairwise(corners))
    return np.concatenate(list(steps))


NOISE_SCENARIO = "example-4.1-1khz"
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
    run = loop(NOISE_SCENARIO, period, ENCODERS | changes).simulate(log_every=None)
    return Point(steady_error(run), steady_step_rms(run), steady_step(run), analysis.envelope_violations(run) or 0)


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
def draw_noise(points: dict[float, dict[tuple[str, float, float], Point]]) -> Figure:
    """The picture: steady error over the torque's restlessness, a panel for each final radius.

    - `points`: by final radius, then by kind, parameter and horizon.
    """
    figure = Figure(figsize=(WIDTH, 3.5), layout="constrained")
    panels = figure.subplots(1, len(points), sharey=True)
    labels = []
    for axes, (radius, panel) in zip(panels, points.items(), strict=True):
        labels.append(_draw(axes, panel))
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


def write_noise() -> None:
    """Measure, and write the figure and its table."""
    points = {
        radius: {
            (kind, value, horizon): _estimator(kind, value, horizon, radius)
            for kind, (*_, values) in ESTIMATORS.items()
            for value in values
            for horizon in HORIZONS
        }
        for radius in RADII
    }
    save(draw_noise(points), "noise-trade-off")

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
    rows.append(row("`measured`", "gain 0.1", 0.012, _point(naive)))
    blind = {"scheme.sampled_data.estimator": {"kind": "measured", "gain": 0.0, "trend": 0.0}}
    rows.append(row("`measured`", "gain 0", 0.012, _point(blind)))
    head = ["estimator", "H [ms]", "steady error [rad]", "torque step, rms [N m]", "largest [N m]", "samples outside"]
    write_table("loop-rate.md", "noise", table(head, rows))
    if any(math.isnan(p.error) for p in first.values()):
        print("noise-trade-off: some runs did not reach their end")
