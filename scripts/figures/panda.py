"""Figures and tables of docs/benchmark-of-schemes.md, and the table of built-in arms in docs/robots.md."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax import analysis, scenarios, simulate_batch
from slidax.law import SampledData, sampled_data
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
    use_time_axis,
)
from slidax.scenarios.schemes import PRESETS
from slidax.simulation import Run

from .shared import save, small, steady_error, steady_step, table, write_table


@dataclass(frozen=True)
class Rival:
    """A law, and the gains that are tried.

    - `scheme`: its name in a scenario file.
    - `title`: its name in a table.
    - `gains`: values by the names of the gains.
    - `chosen`: the leaves of the law that these are, in the same order.
    """

    scheme: str
    title: str
    gains: dict[str, list[float]]
    chosen: Callable[[Any], Any]


COMPUTED_TORQUE = Rival(
    "computed_torque",
    "computed torque + PD",
    {
        "kp": [50.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 800.0, 1600.0, 3200.0],
        "kd": [10.0, 20.0, 40.0, 60.0, 80.0, 120.0, 160.0, 240.0, 320.0, 480.0, 640.0],
    },
    lambda law: (law.kp, law.kd),
)

SLOTINE_LI = Rival(
    "slotine_li",
    "Slotine-Li",
    {
        "rate": [10.0, 20.0, 40.0, 80.0],
        "damping": [2.5, 5.0, 10.0, 20.0, 40.0],
        "gain": [2.5, 5.0, 10.0, 20.0],
        "layer": [0.05, 0.1, 0.2, 0.5, 1.0],
    },
    lambda law: (law.surface.rate, law.damping, law.gain, law.layer),
)

SUPER_TWISTING = Rival(
    "super_twisting",
    "super-twisting",
    {
        "rate": [10.0, 20.0, 40.0, 80.0],
        "k1": [1.0, 3.0, 10.0, 20.0, 30.0],
        "k2": [1.0, 10.0, 100.0, 300.0, 1000.0],
    },
    lambda law: (law.surface.rate, law.k1, law.k2),
)


SEEN = 20
"""The search for gains uses every 20th sample."""


def tuned(
    name: str, rival: Rival, changes: dict[str, Any], drawn: Run, *, sampled: bool
) -> tuple[Run, dict[str, float]]:
    """The best run of all gains that are tried, with every sample logged, and those gains.

    The best has the fewest samples outside the envelope that is drawn, and of those the least steady error.

    - `drawn`: of the law that has the envelope, with every sample logged.
    - `sampled`: whether it has the scenario's estimator, prediction of the delay and limits, or is as in the textbook.
    """
    printed = scenarios.load(name, {"scheme.name": rival.scheme, **changes, "scheme.sampled_data": None})
    plain = {"scheme.name": rival.scheme, **changes, **({} if sampled else {"scheme.sampled_data": None})}
    scenario = scenarios.load(name, plain)
    grid = jnp.asarray(list(itertools.product(*rival.gains.values())))

    def define(gains: Any) -> Any:
        law = eqx.tree_at(rival.chosen, printed.controller, tuple(gains))
        like = scenario.controller
        if isinstance(like, SampledData):
            law = sampled_data(
                law,
                period=like.period,
                horizon=like.horizon,
                estimator=like.estimator,
                adaptation=like.adaptation,
                limits=like.limits,
                delay=like.delay,
                dead_time=like.dead_time,
            )
        return scenario.plant, law, scenario.trajectory, scenario.state0

    runs = simulate_batch(define, grid, t1=scenario.t1, stepping=scenario.stepping, log_every=SEEN)
    e = np.asarray(runs.log.e)
    lower, upper = (np.asarray(side)[::SEEN] for side in (drawn.log.envelope.lower, drawn.log.envelope.upper))
    counts = np.sum(np.any(~((lower < e) & (e < upper)), axis=2), axis=1)
    errors = np.max(np.asarray(runs.tally.steady_error), axis=1)
    ended = (np.asarray(runs.fault.kind) == 0) & np.isfinite(errors)
    order = np.lexsort((np.where(ended, errors, np.inf), np.where(ended, counts, np.inf)))
    best = dict(zip(rival.gains, np.asarray(grid[int(order[0])]).tolist(), strict=True))
    run = scenarios.load(name, {**plain, **{f"scheme.{gain}": value for gain, value in best.items()}}).simulate()
    assert analysis.steady_error(run) is not None
    return run, best


SCENARIO = "panda-payload"

EXACT = {"sensor.resolution": 0.0, "sensor.velocity": "measured"}
"""Exact positions and velocities, one period old."""

AS_PRINTED = {"scheme.sampled_data": None, "scheme.reaching.layer": 0.05, "simulation.outside": "raise"}

RIVALS = (COMPUTED_TORQUE, SLOTINE_LI, SUPER_TWISTING)

SAME = "same estimator, learning, prediction, limits"
"""A rival with everything of the sampled-data law except its envelope and its reaching law."""

COLUMNS = 70

FIRST: dict[str, Any] = {"color": "#C00000", "marker": "o", "linestyle": "none", "markersize": 4}
"""Marker of the first sample outside the envelope."""


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
    shown = []
    for measured, changes in (("encoders", {}), ("exact", EXACT)):
        shown += _with(measured, changes)
    return shown


def _with(measured: str, changes: dict[str, Any]) -> list[Line]:
    ours = scenarios.load(SCENARIO, changes).simulate()
    other = scenarios.load(SCENARIO, {**changes, "simulation.plant": "mujoco"}).simulate()
    printed = scenarios.load(SCENARIO, {**changes, **AS_PRINTED}).simulate()
    shown = [
        Line("CFTSMPPC", "sampled-data", measured, ours),
        Line("CFTSMPPC", "sampled-data, arm moved by MuJoCo", measured, other),
        Line("CFTSMPPC", "as printed", measured, printed),
    ]
    for rival in RIVALS:
        for form, sampled in ((SAME, True), ("textbook", False)):
            run, gains = tuned(SCENARIO, rival, changes, ours, sampled=sampled)
            shown.append(Line(f"{rival.title} ({_listed(gains)})", form, measured, run))
    return shown


def _listed(gains: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in gains.items())


def outside(run: Run, drawn: Run) -> np.ndarray:
    """True for each sample with a joint outside the envelope, also for laws without one.

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
def draw_panda_payload(shown: list[Line]) -> Figure:
    """Magnitudes of the errors under four laws: all seven joints of a law in one panel, with the envelope."""
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


def write_panda_payload() -> None:
    """Simulate all laws, and write the figure and the table of docs/benchmark-of-schemes.md."""
    shown = lines()
    drawn = {line.measured: line.run for line in shown if line.form == "sampled-data"}
    rows = [_row(line, drawn[line.measured]) for line in shown]
    head = ["law", "form", "measurements", "samples outside", "steady error [rad]", "torque step, steady [N m]"]
    write_table("benchmark-of-schemes.md", "panda", table(head, rows))
    save(draw_panda_payload([line for line in shown if line.measured == "encoders"]), "panda-payload")


DRY = {"simulation.plant": "mujoco", "simulation.friction": "dry"}
MUJOCO = {"simulation.plant": "mujoco"}

RUNS = [
    ("panda-payload", "encoders", "own", {}),
    ("panda-payload", "encoders", "MuJoCo", MUJOCO),
    ("panda-payload", "encoders", "MuJoCo, dry friction", DRY),
    ("panda-payload", "exact", "own", EXACT),
    ("panda-payload", "exact", "MuJoCo", {**EXACT, **MUJOCO}),
    ("panda-payload", "exact", "MuJoCo, dry friction", {**EXACT, **DRY}),
    ("ur5e-payload", "encoders", "own", {}),
    ("ur5e-payload", "encoders", "MuJoCo", MUJOCO),
    ("panda-pick", "encoders", "own", {}),
    ("panda-pick", "encoders", "MuJoCo", MUJOCO),
    ("panda-drop", "encoders", "MuJoCo", {}),
    ("panda-table", "encoders", "MuJoCo", {}),
]


def write_arms() -> None:
    """Simulate the built-in scenarios of arms from files, and write the table of docs/robots.md."""
    rows = []
    for name, measured, plant, changes in RUNS:
        run = scenarios.load(name, changes).simulate(log_every=None)
        margin = float(np.min(analysis.envelope_margin(run)))
        count = f"{int(run.tally.violations)}"
        rows.append(
            [name, measured, plant, count, f"{margin:.2f}", small(steady_error(run)), f"{steady_step(run):.2g}"]
        )
    head = ["scenario", "measurements", "plant", "samples outside", "margin", "steady error [rad]", "step [N m]"]
    write_table("robots.md", "arms", table(head, rows))


CHOOSING_HEAD = (
    "| scheme | outcome | settled [s] | steady error [rad] "
    "| peak torque [N m] | torque step, steady [N m] | envelope |\n"
    "|---|---|---:|---:|---:|---:|---|\n"
)


def choosing_row(scheme: str, period: float) -> str:
    """One line of the table.

    - `period`: time between samples [s].
    """
    changes = {"scheme.name": scheme, "simulation.mode": "held", "simulation.period": period}
    run = scenarios.load("example-4.1", changes).simulate(log_every=None)
    peak = f"{np.max(analysis.peak_torque(run)):.0f}"
    if not run.outcome.ok:
        return f"| `{scheme}` | leaves its envelope at {run.outcome.t:.1f} s | | | {peak} | | left |"
    settled = np.max(analysis.settling_time(run, 1e-3))
    shown = f"{settled:.2f}" if settled < 10.0 else "not within 10"
    violations = analysis.envelope_violations(run)
    kept = "none promised" if violations is None else "kept" if violations == 0 else "left"
    error, step = np.max(analysis.steady_error(run)), np.max(analysis.steady_torque_step(run))
    return f"| `{scheme}` | ok | {shown} | {error:.1e} | {peak} | {step:.2g} | {kept} |"


def write_choosing() -> None:
    """Write tables of docs/benchmark-of-schemes.md: every scheme on Example 4.1, held, at two periods."""
    for period in ("1e-4", "1e-3"):
        schemes = [name for name, preset in PRESETS.items() if preset.complete]
        rows = [choosing_row(scheme, float(period)) for scheme in schemes]
        write_table("benchmark-of-schemes.md", period, CHOOSING_HEAD + "\n".join(rows))
