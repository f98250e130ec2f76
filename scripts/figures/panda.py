"""Figures and tables of arms from files: docs/benchmark-of-schemes.md and docs/robots.md."""

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
from slidax.report.replay import Skeleton, skeleton_of
from slidax.simulation import Run

from .shared import DOCS, save, small, steady_error, steady_step, table, write_table


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


RIVAL = SUPER_TWISTING
"""The controller with the least steady error among those with the same estimator (docs/benchmark-of-schemes.md)."""

PICTURE_WIDTH, PICTURE_HEIGHT = 960, 316
PANEL = 470
"""Width of one law's half."""

CHART = (206, 48, 252, 212)
"""Left, top, width and height of the errors in a half."""

ARM = (56, 246, 196)
"""Position of the base in a half, and length of a metre, in the picture's units."""

FRAMES, PAUSE = 40, 0.2
"""Frames of the run, between which points move straight, and its pause at the end as a share of the run."""

TOLERANCE = 0.25
"""A curve is drawn by as few of its points as keep it within this distance, in the picture's units."""

LOAD = 22
"""Side of the box that stands for the payload."""

STRIDE = 5
"""Curves use every fifth sample."""

KNEE = 1e-3
"""The scale of errors is linear up to this error [rad], and logarithmic above."""

TICKS = {1.0: "1", 0.1: "0.1", 0.01: "0.01", 0.0: "0", -0.01: "−0.01", -0.1: "−0.1"}

STYLE = """
svg { color-scheme: light dark; --ink: #1f2328; --soft: #59636e; --band: #e6eef7; --edge: #7d8b99; --grid: #d8dee4;
  --line: #0072b2; --arm: #3d4752; --inner: #9aa7b4; --ghost: #d55e00; --load: #e3b341; --page: #ffffff; }
@media (prefers-color-scheme: dark) { svg { --ink: #f0f6fc; --soft: #a5aeb8; --band: #16293b; --edge: #6f8296;
  --grid: #30363d; --line: #58b3ea; --arm: #c7d1db; --inner: #5b6875; --ghost: #f0883e; --load: #bb8009;
  --page: #0d1117; } }
text { font: 12px system-ui, -apple-system, "Segoe UI", Helvetica, Arial, sans-serif; fill: var(--soft); }
.head { font-size: 15px; font-weight: 600; fill: var(--ink); }
.result { font-size: 13px; fill: var(--ink); }
.errors { fill: none; stroke: var(--line); stroke-width: 1.1; stroke-linejoin: round; }
.arm { fill: none; stroke: var(--arm); stroke-width: 13; stroke-linejoin: round; stroke-linecap: round; }
.inner { fill: none; stroke: var(--inner); stroke-width: 8; stroke-linejoin: round; stroke-linecap: round; }
.ghost { fill: none; stroke: var(--ghost); stroke-width: 3; stroke-linejoin: round; stroke-dasharray: 7 4; }
.load { fill: var(--load); stroke: var(--arm); stroke-width: 2; }
.tick { stroke: var(--grid); stroke-width: 1; }
.edge { fill: none; stroke: var(--edge); stroke-width: 1.2; }
""".strip()


@dataclass(frozen=True)
class Half:
    """One law's side of the picture.

    - `title`, `note`: above it.
    - `run`: with every sample logged.
    """

    title: str
    note: str
    run: Run


def write_panda_moving() -> None:
    """Draw docs/figures/panda-moving.svg: the Panda under this law and the strongest rival.

    It moves by SMIL, so that it needs no script and plays where a page shows it as an image. A viewer that cannot play
    it shows the end of both runs.
    """
    scenario = scenarios.load(SCENARIO)
    ours = scenario.simulate()
    rival, gains = tuned(SCENARIO, RIVAL, {}, ours, sampled=True)
    listed = ", ".join(f"{name} {value:g}" for name, value in gains.items())
    halves = (
        Half("CFTSMPPC, sampled-data", "its envelope is drawn before the run", ours),
        Half(f"{RIVAL.title}, {SAME.split(',')[0]}", f"knows no envelope; gains searched on this run: {listed}", rival),
    )
    text = picture(halves, skeleton_of(scenario.plant.robot), first_signs(ours))
    (DOCS / "figures" / "panda-moving.svg").write_text(text, encoding="utf-8")


def first_signs(run: Run) -> np.ndarray:
    """The sign of each joint's first error [n], by which all are drawn from above."""
    return np.sign(np.asarray(run.log.e)[0])


def picture(halves: tuple[Half, ...], arm: Skeleton, signs: np.ndarray) -> str:
    """The SVG.

    - `halves`: side by side; the first one's law draws the envelope.
    """
    title = "Two laws move a Franka Panda at 1 kHz; the errors of its seven joints stay in the envelope under both."
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {PICTURE_WIDTH} {PICTURE_HEIGHT}" '
        'role="img" aria-labelledby="title">',
        f'<title id="title">{title}</title>',
        f"<style>{STYLE}</style>",
        f'<rect width="{PICTURE_WIDTH}" height="{PICTURE_HEIGHT}" fill="var(--page)"/>',
    ]
    for number, half in enumerate(halves):
        inside = [*_heads(half, halves[0].run), *_chart(half, halves[0].run, signs, number), *_arm(half, arm, number)]
        parts += [f'<g transform="translate({number * (PICTURE_WIDTH - PANEL)} 0)">', *inside, "</g>"]
    return "\n".join([*parts, "</svg>", ""])


def _heads(half: Half, drawn: Run) -> list[str]:
    left, top, _, height = CHART
    count = int(np.sum(outside(half.run, drawn)))
    kept = f"{count} of {len(half.run.log.t)} samples outside"
    last = f"steady error {small(steady_error(half.run))} rad, torque step {steady_step(half.run):.2g} N m"
    return [
        f'<text class="head" x="8" y="20">{half.title}</text>',
        f'<text x="8" y="38">{half.note}</text>',
        f'<text class="result" x="{left - 56}" y="{top + height + 35}">{kept}</text>',
        f'<text class="result" x="{left - 56}" y="{top + height + 52}">{last}</text>',
        f'<text x="8" y="{top + height + 35}">2 kg, unknown to it</text>',
        f'<text x="8" y="{top + height + 52}"><tspan fill="var(--ghost)">dashed</tspan>: reference</text>',
    ]


def _place(value: np.ndarray | float) -> np.ndarray:
    """Upward from 0 at the narrower side's start to 1 at the wider one's."""
    low, high = np.arcsinh(-0.34 / KNEE), np.arcsinh(1.06 / KNEE)
    return np.asarray((np.arcsinh(np.asarray(value) / KNEE) - low) / (high - low))


def _points(x: np.ndarray, y: np.ndarray) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def _chart(half: Half, drawn: Run, signs: np.ndarray, number: int) -> list[str]:
    left, top, width, height = CHART
    end = float(np.asarray(drawn.log.t)[-1])
    bounds: Any = drawn.log.envelope
    # The joints have one envelope; the side that an error starts on is the wide one.
    wide = np.max(np.abs([np.asarray(bounds.lower), np.asarray(bounds.upper)]), axis=(0, 2))
    narrow = np.min(np.abs([np.asarray(bounds.lower), np.asarray(bounds.upper)]), axis=(0, 2))

    def x(t: np.ndarray) -> np.ndarray:
        return np.asarray(left + width * t / end)

    def y(value: np.ndarray | float) -> np.ndarray:
        return np.asarray(top + height * (1.0 - _place(value)))

    times = np.asarray(drawn.log.t)
    up, down = (_curve(x(times[::STRIDE]), y(side[::STRIDE])) for side in (wide, -narrow))
    back = " ".join(reversed(down.split(" ")))
    parts = [f'<polygon points="{up} {back}" fill="var(--band)"/>']
    for value, label in TICKS.items():
        at = float(y(value))
        parts.append(f'<line class="tick" x1="{left}" x2="{left + width}" y1="{at:.1f}" y2="{at:.1f}"/>')
        parts.append(f'<text x="{left - 6}" y="{at + 4:.1f}" text-anchor="end">{label}</text>')
    for second in range(0, round(end) + 1, 2):
        caption = f"{second} s" if second else "0"
        parts.append(f'<text x="{float(x(second)):.1f}" y="{top + height + 15}" text-anchor="middle">{caption}</text>')
    parts += [f'<polyline class="edge" points="{side}"/>' for side in (up, down)]
    caption = "errors of seven joints [rad]"
    parts.append(f'<text x="{left + width - 6}" y="{top + 18}" text-anchor="end">{caption}</text>')
    error = np.asarray(half.run.log.e) * signs
    t = x(np.asarray(half.run.log.t)[::STRIDE])
    run = [f'<polyline class="errors" points="{_curve(t, y(joint))}"/>' for joint in error[::STRIDE].T]
    timing = f'dur="{(1 + PAUSE) * end:.2f}s" repeatCount="indefinite" keyTimes="0;{1 / (1 + PAUSE):.4f};1"'
    parts += [
        f'<clipPath id="seen{number}"><rect x="{left}" y="{top - 10}" width="{width}" height="{height + 20}">',
        f'<animate attributeName="width" values="0;{width};{width}" {timing}/></rect></clipPath>',
        f'<g clip-path="url(#seen{number})">{"".join(run)}</g>',
        f'<line x1="{left + width}" x2="{left + width}" y1="{top}" y2="{top + height}" stroke="var(--soft)">',
        f'<animate attributeName="x1" values="{left};{left + width};{left + width}" {timing}/>',
        f'<animate attributeName="x2" values="{left};{left + width};{left + width}" {timing}/></line>',
    ]
    return parts


def _curve(x: np.ndarray, y: np.ndarray) -> str:
    """The points of a curve that keep it within the tolerance (Ramer 1972, Douglas and Peucker 1973)."""
    kept = {0, len(x) - 1}
    parts = [(0, len(x) - 1)]
    while parts:
        first, last = parts.pop()
        run, rise = x[last] - x[first], y[last] - y[first]
        distance = np.abs(run * (y[first:last] - y[first]) - rise * (x[first:last] - x[first])) / np.hypot(run, rise)
        farthest = first + int(np.argmax(distance))
        if distance[farthest - first] > TOLERANCE:
            kept.add(farthest)
            parts += [(first, farthest), (farthest, last)]
    chosen = sorted(kept)
    return _points(x[chosen], y[chosen])


def _arm(half: Half, arm: Skeleton, number: int) -> list[str]:
    log: Any = half.run.log
    frames = np.linspace(0, len(log.t) - 1, FRAMES + 1).astype(int)
    moving, wanted = (_projected(arm, np.asarray(q)[frames]) for q in (log.state.q, log.reference.q))
    times = ";".join(f"{k / FRAMES / (1 + PAUSE):.3f}" for k in range(FRAMES + 1))
    timing = f'dur="{(1 + PAUSE) * float(log.t[-1]):.2f}s" repeatCount="indefinite" keyTimes="{times};1"'

    def line(attributes: str, places: np.ndarray) -> str:
        points = [_points(*place.T) for place in places]
        values = ";".join([*points, points[-1]])
        animate = f'<animate attributeName="points" {timing} values="{values}"/>'
        return f'<polyline {attributes} points="{points[-1]}">{animate}</polyline>'

    ends = [f"{a - LOAD / 2:.1f} {b - LOAD / 2:.1f}" for a, b in moving[:, -1]]
    moves = ";".join([*ends, ends[-1]])
    x, y, _ = ARM
    name = f'id="arm{number}"'
    return [
        f'<line class="edge" x1="{x - 48}" x2="{x + 48}" y1="{y + 8}" y2="{y + 8}"/>',
        f"<defs>{line(name, moving)}</defs>",
        *(f'<use class="{name}" href="#arm{number}"/>' for name in ("arm", "inner")),
        line('class="ghost"', wanted),
        f'<rect class="load" width="{LOAD}" height="{LOAD}" rx="3" transform="translate({ends[-1]})">'
        f'<animateTransform attributeName="transform" type="translate" {timing} values="{moves}"/></rect>',
    ]


def _projected(arm: Skeleton, q: np.ndarray) -> np.ndarray:
    """The arm's points in the picture [k m 2], from the side and a little above."""
    poses = arm.poses(q)
    chain = np.array(arm.chain) + 1
    places = np.concatenate([poses.positions[:, :1], poses.positions[:, chain], arm.tips(poses)[:, None]], axis=1)
    apart = np.linalg.norm(np.diff(places[0], axis=0), axis=1) > 1e-6
    places = places[:, np.append(True, apart)]
    around, above = np.radians(-24.0), np.radians(12.0)
    across = places[..., 0] * np.cos(around) - places[..., 1] * np.sin(around)
    deep = places[..., 0] * np.sin(around) + places[..., 1] * np.cos(around)
    x, y, metre = ARM
    up = places[..., 2] * np.cos(above) + deep * np.sin(above)
    return np.stack([x + metre * across, y - metre * up], axis=-1)
