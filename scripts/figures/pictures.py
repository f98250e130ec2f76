"""Pictures that are written as SVG line by line: README's, with its table, and the moving Panda of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax import scenarios
from slidax.certify.motion.admission import tracking_bound
from slidax.report.figures.style import off_lines
from slidax.report.replay import Skeleton, skeleton_of
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description, read_description
from slidax.simulation import Run
from slidax.studies.cases import Cases, points

from .panda import SAME, SCENARIO, SUPER_TWISTING, outside, tuned
from .shared import DOCS, ROOT, small, steady_error, steady_step, table, write_table

Floats = NDArray[np.float64]

HERO_SCENARIO = ROOT / "examples" / "motions" / "panda.yaml"

ENVELOPE = {"tolerance.performance.initial": 0.01, "tolerance.performance.final": 0.0015}
"""The tolerance band of the picture [rad], narrower than that of the example."""

TEXTBOOK = {"scheme.sampled_data": None}
"""Computed torque with the same model and gains, but without estimator and prediction."""

ARMS, SEED, CHUNK = 1000, 1, 100

DRAWN = 18
"""Arms that are drawn as single curves."""


@dataclass(frozen=True)
class Layout:
    """Size of the picture, and left, top, width and height of its axes; on a phone the labels are below the curves."""

    width: int
    height: int
    left: int
    top: int
    across: int
    down: int
    labels_below: bool = False


LAYOUTS = {
    "hero": Layout(880, 384, 62, 46, 560, 300),
    "hero-phone": Layout(400, 430, 46, 40, 344, 240, labels_below=True),
}
"""By the name of the file."""

LOW, HIGH = 1e-3, 20.0
"""Ends of the axis of errors [mrad]."""

HERO_STYLE = """
svg { --page: #fff; --ink: #1d2228; --soft: #59636e; --rule: #e3e8ed; --band: #eef2f6; --edge: #8794a1;
  --bound: #0f7a45; --fan: #3987c9; --bad: #c0392b; }
@media (prefers-color-scheme: dark) { svg { --page: #0d1117; --ink: #e6edf3; --soft: #9da7b1; --rule: #262d36;
  --band: #1a212a; --edge: #7d8a98; --bound: #4bc58a; --fan: #6cb0ee; --bad: #ff8b7a; } }
text { font: 13px system-ui, -apple-system, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; fill: var(--soft); }
.head { font-size: 15px; font-weight: 600; fill: var(--ink); }
.name { font-weight: 600; }
.below { font-size: 12px; }
polyline { fill: none; stroke-linejoin: round; }
"""


def _opening(width: int, height: int, title: str, style: str) -> list[str]:
    """The beginning of an SVG: its size, title, style and background."""
    return [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" aria-labelledby="title">',
        f'<title id="title">{title}</title>',
        f"<style>{style}</style>",
        f'<rect width="{width}" height="{height}" fill="var(--page)"/>',
    ]


def write_hero() -> None:
    """Draw docs/figures/hero.svg and the one for phones, and write the numbers in them into README.md."""
    scenario = scenarios.load(HERO_SCENARIO, ENVELOPE)
    verdict = tracking_bound(scenario)
    if not verdict.holds or verdict.grade != "A":
        raise SystemExit(f"the picture shows a proved bound, and this one is not: {verdict.statement}")
    t, ours = errors({})
    # Each value holds from its time to the next.
    cells = np.searchsorted(verdict.bound["times"], t, side="right") - 1
    bound = 1e3 * np.asarray(verdict.bound["error_over_time"]).max(axis=1)[np.maximum(cells, 0)]
    _, textbook = errors(TEXTBOOK)
    envelope = 1e3 * _envelope(scenario, t)
    for name, layout in LAYOUTS.items():
        text = draw_hero(layout, t, envelope, bound, ours, textbook)
        (DOCS / "figures" / f"{name}.svg").write_text(text, encoding="utf-8")
    rows = [
        ["envelope that you set, from 0.2 s on", f"{envelope[-1]:.2f}"],
        ["bound proved before the run (`slidax admit`, grade A)", f"{bound.max():.2f}"],
        [f"largest of {ARMS} simulated arms", f"{ours.max():.2f}"],
        ["textbook computed torque, the same arms, model and gains", f"{textbook.max():.2f}"],
    ]
    write_table("../README.md", "hero", table(["Panda at 1 kHz with 2 kg", "error of the worst joint [mrad]"], rows))


def errors(changes: dict[str, Any]) -> tuple[Floats, Floats]:
    """The largest error of all joints of each random arm over time [arms, k], mrad, and the times [k], s.

    - `changes`: of the law.
    """
    family = Family.of(alter_description(read_description(HERO_SCENARIO), changes))
    cases = Cases(family)
    sizes, times = [], np.zeros(0)
    for first in range(0, ARMS, CHUNK):
        for run in cases.logged(family.uncertain.values(points(SEED, first, CHUNK, family.uncertain.dimensions))):
            times = np.asarray(run.log.t)
            sizes.append(1e3 * np.abs(np.asarray(run.log.e)).max(axis=1))
    return times, np.stack(sizes)


def _envelope(scenario: Any, t: Floats) -> Floats:
    """The narrower side of the tolerance band of the first joint, all being alike [k], rad."""
    band = scenario.tolerance
    memory = band.init(jnp.zeros(()), jnp.zeros(scenario.controller.joints))
    sides = jax.vmap(band.envelope, (0, None))(jnp.asarray(t), memory)
    return np.minimum(-np.asarray(sides.lower), np.asarray(sides.upper))[:, 0]


def draw_hero(layout: Layout, t: Floats, envelope: Floats, bound: Floats, ours: Floats, textbook: Floats) -> str:
    """The SVG.

    - `layout`: its size and places.
    - `t`: times of the samples [k], s.
    - `envelope`, `bound`: the one that is set and the one that is proved [k], mrad.
    - `ours`, `textbook`: errors of each arm [arms, k], mrad.
    """
    end = float(t[-1])
    left, top, across, down = layout.left, layout.top, layout.across, layout.down

    def x(time: Any) -> Floats:
        return left + across * np.asarray(time) / end

    def y(value: Any) -> Floats:
        place = np.log10(np.clip(value, LOW, HIGH) / LOW) / np.log10(HIGH / LOW)
        return np.asarray(top + down * (1.0 - place))

    def line(time: Any, value: Any, look: str) -> str:
        return f'<polyline points="{_reduced(x(time), y(value))}" {look}/>'

    def area(time: Floats, low: Floats, high: Floats, look: str) -> str:
        points = _reduced(np.append(x(time), x(time)[::-1]), np.append(y(high), y(low)[::-1]))
        return f'<polygon points="{points}" {look}/>'

    coarse = np.unique(np.append(np.arange(0, len(t), 8), len(t) - 1))
    time = t[coarse]
    widest, least = ours[:, coarse].max(axis=0), ours[:, coarse].min(axis=0)
    floor = np.full(len(coarse), LOW)
    title = (
        "Error of the worst joint over time: 1000 arms below the proved bound, which is below the envelope; textbook "
        "computed torque leaves the envelope."
    )
    start = 0 if layout.labels_below else left
    parts = [
        *_opening(layout.width, layout.height, title, HERO_STYLE),
        f'<text class="head" x="{start}" y="22">Error of the worst joint over one motion [mrad]</text>',
        area(time, floor, envelope[coarse], 'fill="var(--band)"'),
    ]
    for decade in (0.001, 0.01, 0.1, 1.0, 10.0):
        at = float(y(decade))
        parts.append(f'<line x1="{left}" x2="{left + across}" y1="{at:.1f}" y2="{at:.1f}" stroke="var(--rule)"/>')
        parts.append(f'<text x="{left - 8}" y="{at + 4:.1f}" text-anchor="end">{decade:g}</text>')
    for second in np.arange(0.0, end + 0.1, 0.5):
        label = f"{second:g} s" if second else "0"
        parts.append(f'<text x="{float(x(second)):.0f}" y="{top + down + 20}" text-anchor="middle">{label}</text>')
    parts.append(area(time, least, widest, 'fill="var(--fan)" fill-opacity="0.22"'))
    thin = 'stroke="var(--fan)" stroke-width="0.7" stroke-opacity="0.55"'
    parts += [line(time, each[coarse], thin) for each in ours[:DRAWN]]
    parts += [
        line(time, textbook[:, coarse].max(axis=0), 'stroke="var(--bad)" stroke-width="2.2"'),
        line(t[::4], bound[::4], 'stroke="var(--bound)" stroke-width="2.4"'),
        line(t[::4], envelope[::4], 'stroke="var(--edge)" stroke-width="2" stroke-dasharray="7 4"'),
    ]
    labels = [
        ("envelope", "set by you", "edge", y(envelope[-1])),
        ("bound", "proved before the run", "bound", y(bound[-1])),
        (f"{ARMS} uncertain arms", "mass, inertia, friction vary", "fan", y(ours[:, -1].max())),
        ("textbook computed torque", "same arms, model and gains", "bad", y(textbook[:, -1].max())),
    ]
    place_labels = _labels_below if layout.labels_below else _labels_to_the_right
    parts += place_labels(labels, layout)
    return "\n".join([*parts, "</svg>", ""])


LABEL = 38.0
"""Height of a label."""


Label = tuple[str, str, str, Any]
"""Name and note of a curve, its colour, and the height of its end."""


def _labels_below(labels: list[Label], layout: Layout) -> list[str]:
    """Names and notes below the axes, each after a line in its curve's colour."""
    parts = []
    for row, (name, note, colour, _) in enumerate(labels):
        at = layout.top + layout.down + 52 + 28 * row
        parts.append(
            f'<path d="M2 {at - 4}h20" stroke="var(--{colour})" stroke-width="3"/>'
            f'<text class="below" x="30" y="{at}"><tspan class="name" fill="var(--{colour})">{name}</tspan>'
            f" {note}</text>"
        )
    return parts


def _labels_to_the_right(labels: list[Label], layout: Layout) -> list[str]:
    """Names right of the ends of the curves, apart from each other, with a line to each end."""
    labels = sorted(labels, key=lambda label: float(label[3]))
    middle = float(np.mean([float(at) for *_, at in labels[:-1]]))
    heights: list[float] = []
    for number, (*_, at) in enumerate(labels):
        wanted = min(float(at), middle - LABEL) if number == 0 else float(at)
        heights.append(max(wanted, heights[-1] + LABEL) if heights else wanted)
    parts = []
    right = layout.left + layout.across
    for (name, note, colour, at), height in zip(labels, heights, strict=True):
        parts.append(
            f'<path d="M{right + 2} {float(at):.1f}L{right + 14} {height:.1f}" stroke="var(--{colour})" fill="none"/>'
            f'<text x="{right + 18}" y="{height:.1f}"><tspan class="name" fill="var(--{colour})">{name}</tspan>'
            f'<tspan x="{right + 18}" dy="16">{note}</tspan></text>'
        )
    return parts


def _reduced(x: Floats, y: Floats) -> str:
    """The points of a curve, without those on the line between their neighbours, to a tenth of a pixel."""
    places = np.stack([x, y], axis=-1)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in places[off_lines(places, 0.12)])


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

MOVING_STYLE = """
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
    text = draw_moving(halves, skeleton_of(scenario.plant.robot), first_signs(ours))
    (DOCS / "figures" / "panda-moving.svg").write_text(text, encoding="utf-8")


def first_signs(run: Run) -> np.ndarray:
    """The sign of each joint's first error [n], by which all are drawn from above."""
    return np.sign(np.asarray(run.log.e)[0])


def draw_moving(halves: tuple[Half, ...], arm: Skeleton, signs: np.ndarray) -> str:
    """The SVG.

    - `halves`: side by side; the first one's law draws the envelope.
    """
    title = "Two laws move a Franka Panda at 1 kHz; the errors of its seven joints stay in the envelope under both."
    parts = _opening(PICTURE_WIDTH, PICTURE_HEIGHT, title, MOVING_STYLE)
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
