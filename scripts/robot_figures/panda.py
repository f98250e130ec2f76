"""The project's claim: one law beside its rivals, on a seven-joint arm at 1 kHz with all that a real one has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from sampled_data_figures.loops import save, small, steady_error, steady_step, table, write_table

from slidax import scenarios
from slidax.figures.axes import use_time_axis
from slidax.figures.overlay import crest
from slidax.figures.style import BAND, BOUND, LINES, NARROW, WIDTH, envelope_patch, legend_above, styled
from slidax.figures.thinning import every_nth
from slidax.simulation import Run

from .tuned import COMPUTED_TORQUE, SLOTINE_LI, SUPER_TWISTING, tuned

SCENARIO = "panda-payload"

EXACT = {"sensor.resolution": 0.0, "sensor.velocity": "measured"}
"""Positions and velocities as they are, one period old."""

AS_PRINTED = {"scheme.sampled_data": None, "scheme.reaching.layer": 0.05, "simulation.outside": "raise"}

RIVALS = (COMPUTED_TORQUE, SLOTINE_LI, SUPER_TWISTING)

SAME = "same estimator, learning, prediction, limits"
"""The form of a rival that has all that the sampled-data law has but its envelope and its reaching law."""

COLUMNS = 100

FIRST: dict[str, Any] = {"color": "#C00000", "marker": "o", "linestyle": "none", "markersize": 4}
"""Where an error leaves the envelope."""


@dataclass(frozen=True)
class Line:
    """A law's run with one kind of measurements.

    - `name`, `form`: of the law.
    - `measured`: of the kind.
    - `run`: with every sample logged.
    """

    name: str
    form: str
    measured: str
    run: Run


def lines() -> list[Line]:
    """All laws with encoders alone, and then with exact measurements."""
    found = []
    for measured, changes in (("encoders", {}), ("exact", EXACT)):
        found += _with(measured, changes)
    return found


def _with(measured: str, changes: dict[str, Any]) -> list[Line]:
    ours = scenarios.load(SCENARIO, changes).simulate()
    other = scenarios.load(SCENARIO, {**changes, "simulation.plant": "mujoco"}).simulate()
    printed = scenarios.load(SCENARIO, {**changes, **AS_PRINTED}).simulate()
    found = [
        Line("CFTSMPPC", "sampled-data", measured, ours),
        Line("CFTSMPPC", "sampled-data, arm moved by MuJoCo", measured, other),
        Line("CFTSMPPC", "as printed", measured, printed),
    ]
    for rival in RIVALS:
        for form, sampled in ((SAME, True), ("textbook", False)):
            run, gains = tuned(SCENARIO, rival, changes, ours, sampled=sampled)
            found.append(Line(f"{rival.title} ({_listed(gains)})", form, measured, run))
    return found


def _listed(gains: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in gains.items())


def outside(run: Run, drawn: Run) -> np.ndarray:
    """Which samples have a joint outside the envelope, whether the law knows of it or not.

    - `run`: of any law.
    - `drawn`: of the law that has the envelope.
    """
    e, count = np.asarray(run.log.e), len(run.log.t)
    lower, upper = np.asarray(drawn.log.envelope.lower)[:count], np.asarray(drawn.log.envelope.upper)[:count]
    return np.any((e <= lower) | (e >= upper), axis=1)


def _row(line: Line, drawn: Run) -> list[str]:
    if line.run.outcome.kind in ("left_envelope", "not_finite") and line.run.fault.kind:
        what = "left its envelope" if line.run.outcome.kind == "left_envelope" else "became infinite"
        return [line.name, line.form, line.measured, f"{what} at {line.run.outcome.t:.3g} s", "", ""]
    count = int(np.sum(outside(line.run, drawn)))
    error, step = steady_error(line.run), steady_step(line.run)
    return [line.name, line.form, line.measured, f"{count} of {len(line.run.log.t)}", small(error), f"{step:.2g}"]


@styled
def draw(shown: list[Line]) -> Figure:
    """The sizes of the errors of four laws, all seven joints in one panel each, in the envelope that one of them keeps.

    - `shown`: the lines with encoders.
    """
    figure = Figure(figsize=(WIDTH, 4.1), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    ours = shown[0].run
    bounds, t = ours.log.envelope, np.asarray(ours.log.t)
    widest = np.max(np.abs([np.asarray(bounds.lower), np.asarray(bounds.upper)]), axis=(0, 2))
    narrowest = np.min(np.abs([np.asarray(bounds.lower), np.asarray(bounds.upper)]), axis=(0, 2))
    marks: list[Line2D] = []
    by_name = {(line.name.split(" (")[0], line.form): line.run for line in shown}
    titles = {
        "CFTSMPPC, sampled-data": ("CFTSMPPC", "sampled-data"),
        "CFTSMPPC as printed": ("CFTSMPPC", "as printed"),
        "computed torque + PD, the same estimator": (COMPUTED_TORQUE.title, SAME),
        "Slotine-Li, the same estimator": (SLOTINE_LI.title, SAME),
    }
    for axes, (title, key) in zip(panels, titles.items(), strict=True):
        run = by_name[key]
        axes.set_yscale("log")
        axes.set_ylim(1e-6, 3.0)
        time = every_nth(t, 40)
        axes.fill_between(time, 1e-6, every_nth(narrowest, 40), **BAND)
        axes.plot(time, every_nth(narrowest, 40), **BOUND)
        axes.plot(time, every_nth(widest, 40), **NARROW)
        errors, times = np.abs(np.asarray(run.log.e)), np.asarray(run.log.t)
        columns = max(2, round(COLUMNS * float(times[-1]) / float(t[-1])))
        for joint in range(errors.shape[1]):
            axes.plot(*crest(times, errors[:, joint], columns), color=LINES[0]["color"], linewidth=0.6, alpha=0.75)
        over = outside(run, ours)
        if over.any():
            first = int(np.argmax(over))
            axes.plot(times[first], errors[first].max(), **FIRST, zorder=4)
            marks = [Line2D([], [], **FIRST, label="first sample outside")]
        axes.set_title(title)
        if run.log.t[-1] < t[-1]:
            axes.axvspan(float(times[-1]), float(t[-1]), facecolor="1", edgecolor="none", alpha=0.72, zorder=3)
            axes.annotate(
                f"the run is over at {run.outcome.t:.2g} s", (float(times[-1]), 2e-4), (12, 0),
                textcoords="offset points", color="#C00000", zorder=5,
            )  # fmt: skip
        use_time_axis(axes, 0.0, float(t[-1]))
    for axes in panels[::2]:
        axes.set_ylabel(r"$|e|$ of each joint  [rad]")
    legend_above(
        figure,
        [
            Line2D([], [], color=LINES[0]["color"], linewidth=0.8, label="error, seven joints"),
            envelope_patch("envelope, its narrowest side"),
            Line2D([], [], **NARROW, label="its widest side"),
            *marks,
        ],
    )
    return figure


def make() -> None:
    """Simulates all of them, and writes the figure and the table of docs/rivals.md."""
    found = lines()
    drawn = {line.measured: line.run for line in found if line.form == "sampled-data"}
    rows = [_row(line, drawn[line.measured]) for line in found]
    head = ["law", "form", "measurements", "samples outside", "steady error [rad]", "torque step, steady [N m]"]
    write_table("rivals.md", "panda", table(head, rows))
    save(draw([line for line in found if line.measured == "encoders"]), "panda-payload")
