"""README's picture and its table: a certified bound, a thousand arms under it, and textbook computed torque."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .shared import DOCS, ROOT, table, write_table

Floats = NDArray[np.float64]

SCENARIO = ROOT / "examples" / "motions" / "panda.yaml"

ENVELOPE = {"tolerance.performance.initial": 0.01, "tolerance.performance.final": 0.0015}
"""The tolerance band of the picture [rad], narrower than that of the example."""

TEXTBOOK = {"scheme.sampled_data": None}
"""Computed torque with the same model and gains, but without estimator and prediction."""

ARMS, SEED, CHUNK = 1000, 1, 100

DRAWN = 18
"""Arms that are drawn as single curves."""

WIDTH, HEIGHT = 880, 384
LEFT, TOP, ACROSS, DOWN = 62, 46, 560, 300
LOW, HIGH = 1e-3, 20.0
"""Ends of the axis of errors [mrad]."""

STYLE = """
svg { --page: #fff; --ink: #1d2228; --soft: #59636e; --rule: #e3e8ed; --band: #eef2f6; --edge: #8794a1;
  --bound: #0f7a45; --fan: #3987c9; --bad: #c0392b; }
@media (prefers-color-scheme: dark) { svg { --page: #0d1117; --ink: #e6edf3; --soft: #9da7b1; --rule: #262d36;
  --band: #1a212a; --edge: #7d8a98; --bound: #4bc58a; --fan: #6cb0ee; --bad: #ff8b7a; } }
text { font: 13px system-ui, -apple-system, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; fill: var(--soft); }
.head { font-size: 15px; font-weight: 600; fill: var(--ink); }
.name { font-weight: 600; }
polyline { fill: none; stroke-linejoin: round; }
"""


def write_hero() -> None:
    """Draw docs/figures/hero.svg, and write the numbers in it into README.md."""
    from slidax import scenarios
    from slidax.certify.motion.admission import tracking_bound

    scenario = scenarios.load(SCENARIO, ENVELOPE)
    verdict = tracking_bound(scenario)
    if not verdict.holds or verdict.grade != "A":
        raise SystemExit(f"the picture shows a proved bound, and this one is not: {verdict.statement}")
    t, ours = errors({})
    # Each value holds from its time to the next.
    cells = np.searchsorted(verdict.bound["times"], t, side="right") - 1
    bound = 1e3 * np.asarray(verdict.bound["error_over_time"]).max(axis=1)[np.maximum(cells, 0)]
    _, textbook = errors(TEXTBOOK)
    envelope = 1e3 * _envelope(scenario, t)
    text = picture(t, envelope, bound, ours, textbook)
    (DOCS / "figures" / "hero.svg").write_text(text, encoding="utf-8")
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
    from slidax.scenarios.family import Family
    from slidax.scenarios.load import alter_description, read_description
    from slidax.studies.cases import Cases, points

    family = Family.of(alter_description(read_description(SCENARIO), changes))
    cases = Cases(family)
    sizes, times = [], np.zeros(0)
    for first in range(0, ARMS, CHUNK):
        for run in cases.logged(family.uncertain.values(points(SEED, first, CHUNK, family.uncertain.dimensions))):
            times = np.asarray(run.log.t)
            sizes.append(1e3 * np.abs(np.asarray(run.log.e)).max(axis=1))
    return times, np.stack(sizes)


def _envelope(scenario: Any, t: Floats) -> Floats:
    """The narrower side of the tolerance band of the first joint, all being alike [k], rad."""
    import jax
    import jax.numpy as jnp

    band = scenario.tolerance
    memory = band.init(jnp.zeros(()), jnp.zeros(scenario.controller.joints))
    sides = jax.vmap(band.envelope, (0, None))(jnp.asarray(t), memory)
    return np.minimum(-np.asarray(sides.lower), np.asarray(sides.upper))[:, 0]


def picture(t: Floats, envelope: Floats, bound: Floats, ours: Floats, textbook: Floats) -> str:
    """The SVG.

    - `t`: times of the samples [k], s.
    - `envelope`, `bound`: the one that is set and the one that is proved [k], mrad.
    - `ours`, `textbook`: errors of each arm [arms, k], mrad.
    """
    end = float(t[-1])

    def x(time: Any) -> Floats:
        return LEFT + ACROSS * np.asarray(time) / end

    def y(value: Any) -> Floats:
        place = np.log10(np.clip(value, LOW, HIGH) / LOW) / np.log10(HIGH / LOW)
        return np.asarray(TOP + DOWN * (1.0 - place))

    def line(time: Any, value: Any, look: str) -> str:
        return f'<polyline points="{_points(x(time), y(value))}" {look}/>'

    def area(time: Floats, low: Floats, high: Floats, look: str) -> str:
        points = _points(np.append(x(time), x(time)[::-1]), np.append(y(high), y(low)[::-1]))
        return f'<polygon points="{points}" {look}/>'

    coarse = np.unique(np.append(np.arange(0, len(t), 8), len(t) - 1))
    time = t[coarse]
    widest, least = ours[:, coarse].max(axis=0), ours[:, coarse].min(axis=0)
    floor = np.full(len(coarse), LOW)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-labelledby="title">',
        '<title id="title">Error of the worst joint over time: 1000 arms below the proved bound, which is below the '
        "envelope; textbook computed torque leaves the envelope.</title>",
        f"<style>{STYLE}</style>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="var(--page)"/>',
        f'<text class="head" x="{LEFT}" y="22">Error of the worst joint over one motion [mrad]</text>',
        area(time, floor, envelope[coarse], 'fill="var(--band)"'),
    ]
    for decade in (0.001, 0.01, 0.1, 1.0, 10.0):
        at = float(y(decade))
        parts.append(f'<line x1="{LEFT}" x2="{LEFT + ACROSS}" y1="{at:.1f}" y2="{at:.1f}" stroke="var(--rule)"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{at + 4:.1f}" text-anchor="end">{decade:g}</text>')
    for second in np.arange(0.0, end + 0.1, 0.5):
        label = f"{second:g} s" if second else "0"
        parts.append(f'<text x="{float(x(second)):.0f}" y="{TOP + DOWN + 20}" text-anchor="middle">{label}</text>')
    parts.append(area(time, least, widest, 'fill="var(--fan)" fill-opacity="0.22"'))
    thin = 'stroke="var(--fan)" stroke-width="0.7" stroke-opacity="0.55"'
    parts += [line(time, each[coarse], thin) for each in ours[:DRAWN]]
    parts += [
        line(time, textbook[:, coarse].max(axis=0), 'stroke="var(--bad)" stroke-width="2.2"'),
        line(t[::4], bound[::4], 'stroke="var(--bound)" stroke-width="2.4"'),
        line(t[::4], envelope[::4], 'stroke="var(--edge)" stroke-width="2" stroke-dasharray="7 4"'),
    ]
    parts += _labels(
        [
            ("textbook computed torque", "same arms, model and gains", "bad", y(textbook[:, -1].max())),
            ("envelope", "set by you", "edge", y(envelope[-1])),
            ("bound", "proved before the run", "bound", y(bound[-1])),
            (f"{ARMS} uncertain arms", "mass, inertia, friction vary", "fan", y(ours[:, -1].max())),
        ]
    )
    return "\n".join([*parts, "</svg>", ""])


LABEL = 38.0
"""Height of a label."""


def _labels(labels: list[tuple[str, str, str, Any]]) -> list[str]:
    """Names right of the ends of the curves, apart from each other, with a line to each end."""
    labels = sorted(labels, key=lambda label: float(label[3]))
    middle = float(np.mean([float(at) for *_, at in labels[:-1]]))
    heights: list[float] = []
    for number, (*_, at) in enumerate(labels):
        wanted = min(float(at), middle - LABEL) if number == 0 else float(at)
        heights.append(max(wanted, heights[-1] + LABEL) if heights else wanted)
    parts = []
    right = LEFT + ACROSS
    for (name, note, colour, at), height in zip(labels, heights, strict=True):
        parts.append(
            f'<path d="M{right + 2} {float(at):.1f}L{right + 14} {height:.1f}" stroke="var(--{colour})" fill="none"/>'
            f'<text x="{right + 18}" y="{height:.1f}"><tspan class="name" fill="var(--{colour})">{name}</tspan>'
            f'<tspan x="{right + 18}" dy="16">{note}</tspan></text>'
        )
    return parts


def _points(x: Floats, y: Floats) -> str:
    """The points of a curve, without those on the line between their neighbours, to a tenth of a pixel."""
    from slidax.report.figures.style import off_lines

    places = np.stack([x, y], axis=-1)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in places[off_lines(places, 0.12)])
