"""The printed law and its sampled-data form on the same arm at 1 kHz."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from slidax import scenarios
from slidax.figures.axes import use_size_axis, use_time_axis
from slidax.figures.overlay import crest
from slidax.figures.style import BAND, BOUND, LINES, NARROW, WIDTH, envelope_patch, legend_above, styled
from slidax.figures.thinning import every_nth, thinned
from slidax.simulation import Run

from .loops import save

SCENARIO = "example-4.1-1khz"
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
def draw(printed: Run, sampled: Run) -> Figure:
    """The picture: sizes of the errors in their envelopes and the torques, the printed law to the left.

    - `printed`: a run that ends where it leaves the envelope.
    - `sampled`: a run that reaches its end.
    """
    figure = Figure(figsize=(WIDTH, 4.3), layout="constrained")
    panels = figure.subplots(3, 2, sharex=True, sharey="row")
    use_size_axis(panels[:2].ravel(), np.concatenate([_crest(sampled, joint)[1] for joint in (0, 1)]))
    for column, run in enumerate((printed, sampled)):
        for joint in (0, 1):
            _draw_size(panels[joint, column], run, sampled, joint)
        torque = panels[2, column]
        for joint, look in enumerate(LINES[:2]):
            points = thinned(np.asarray(run.log.t), np.asarray(run.log.tau)[:, joint], 60)
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


def make() -> None:
    """Simulates both, and writes the figure."""
    as_printed = {"scheme.sampled_data": None, "scheme.reaching.layer": 0.05, "simulation.outside": "raise"}
    printed = scenarios.load(SCENARIO, as_printed).simulate(log_every=1)
    sampled = scenarios.load(SCENARIO).simulate(log_every=1)
    save(draw(printed, sampled), "one-kilohertz")
