"""Closed loops at any sample time, and the pictures and tables of the documentation.

slidax is imported by the functions that need it: a program that forks must not import JAX before.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario
    from slidax.simulation import Run

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

STEP = 2e-4
"""The plant's own step is at most so long [s]."""

MARKERS = re.compile(r'(<g clip-path="[^"]*")>\n((?:<use [^>]*? style="([^"]*)"/>\n)(?:<use [^>]*? style="\3"/>\n)*)')

CURVE = re.compile(r'(?<= d=")[^"]*')
HUNDREDTHS = re.compile(r"\b\d+\.\d\d\b")
COMMAND = re.compile(r"\s*([A-Za-z])\s*")
HASHED = re.compile(r'\bid="(\w+-[mp])([0-9a-f]{10})"')
SPACE = re.compile(r'<path id="([^"]*)"(?: transform="[^"]*")?/>')
GLYPH = re.compile(r'(<use xlink:href="[^"]*" x=")(\d+\.\d+)(?="/>)')

BARE = {
    "scheme.sampled_data.estimator": {"kind": "measured", "gain": 0.0, "trend": 0.0},
    "scheme.sampled_data.recovery": None,
    "scheme.sampled_data.adaptation": None,
}
"""The sampled-data law without an estimate of the disturbance, learning, and a way back: the plain implicit step."""


def loop(name: str, period: float, changes: dict[str, Any] | None = None, *, t1: float = 10.0) -> Scenario:
    """A built-in scenario, held, at another period.

    - `period`: h [s].
    - `t1`: about when it ends [s].
    """
    held = {
        "simulation.mode": "held",
        "simulation.period": period,
        "simulation.substeps": math.ceil(period / STEP - 1e-9),
        "simulation.t1": round(t1 / period) * period,
    }
    from slidax import scenarios

    return scenarios.load(name, held | (changes or {}))


def steady_error(run: Run) -> float:
    """The worst joint's largest error over the last quarter; NaN if the run ended before."""
    return _worst("steady_error", run)


def steady_step(run: Run) -> float:
    """The worst joint's largest torque step over the last quarter; NaN if the run ended before."""
    return _worst("steady_torque_step", run)


def steady_step_rms(run: Run) -> float:
    """The worst joint's root mean square of torque steps over the last quarter; NaN if the run ended before."""
    return _worst("steady_torque_step_rms", run)


def _worst(metric: str, run: Run) -> float:
    from slidax import analysis

    values = getattr(analysis, metric)(run)
    return math.nan if values is None else float(np.max(values))


def order(h: Sequence[float], values: Sequence[float], low: float, high: float) -> float:
    """The slope of the values over h, both in logarithms, fitted for `low <= h <= high`.

    - `h`: periods [s].
    - `low`, `high`: [s].
    """
    kept = [(math.log(a), math.log(b)) for a, b in zip(h, values, strict=True) if low * 0.999 <= a <= high * 1.001]
    return float(np.polyfit(*zip(*kept, strict=True), 1)[0])


def smallest(holds: Callable[[float], bool], low: float, high: float, halvings: int) -> float:
    """The smallest number for which something holds, by halving the interval of its logarithm.

    - `holds`: false below that number, true above it.
    """
    for _ in range(halvings):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown, the first column to the left and the others to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    text = "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
    return text.replace("| --- |", "|---|").replace(" ---: |", "---:|")


def write_table(page: str, name: str, text: str) -> None:
    """Put a table between its marks in a page."""
    path = DOCS / page
    mark = f"<!-- table {name} -->"
    old = path.read_text(encoding="utf-8")
    new, count = re.subn(f"{mark}.*?<!-- end -->", lambda _: f"{mark}\n\n{text}\n\n<!-- end -->", old, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"docs/{page} must have the mark `{mark}` once, and has it {count} times")
    path.write_text(new, encoding="utf-8")


def save(figure: Figure, name: str) -> None:
    """Write a picture of the documentation, without the comments and spaces that matplotlib puts between the lines.

    - `name`: of the file in docs/figures, without its ending.
    """
    from slidax.report.figures import style as svg

    text = svg.to_svg(figure, "".join(word[0] for word in name.split("-")))
    text = re.sub(r"<!--.*?-->|(?<=\n)[ ]+", "", text)
    # A tenth of a point is enough for a curve.
    text = CURVE.sub(lambda data: HUNDREDTHS.sub(lambda number: f"{float(number[0]):.1f}", data[0]), text)
    text = CURVE.sub(lambda data: COMMAND.sub(r"\1", data[0]), text)
    for number, (prefix, digits) in enumerate(dict.fromkeys(HASHED.findall(text))):
        text = text.replace(f"{prefix}{digits}", f"{prefix}{number}")
    text = MARKERS.sub(_with_one_style, text)
    text = _without_spaces(text)
    path = DOCS / "figures" / f"{name}.svg"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(re.sub(r"\n+", "\n", text), encoding="utf-8")


def _without_spaces(text: str) -> str:
    """The text without the glyphs of spaces; the others to a hundredth of a letter's height, their unit."""
    for space in SPACE.findall(text):
        text = re.sub(rf'<(?:use xlink:href="#|path id="){re.escape(space)}"[^>]*/>\n', "", text)
    return GLYPH.sub(lambda use: f"{use[1]}{float(use[2]):.0f}", text)


def _with_one_style(markers: re.Match[str]) -> str:
    """The markers of one line, with what they have in common said once."""
    group, uses, style = markers.groups()
    return f'{group} style="{style}">\n' + uses.replace(f' style="{style}"', "")


def plain_numbers(axes: Axes, x: Sequence[float], y: Sequence[float] | None = None) -> None:
    """Ticks at these places only, labelled as `0.1` and not as a power of ten.

    - `x`, `y`: where; None leaves the axis at powers of ten.
    """
    for axis, places in ((axes.xaxis, x), (axes.yaxis, y)):
        axis.set_minor_locator(NullLocator())
        if places is not None:
            axis.set_ticks(places)
            axis.set_major_formatter(lambda value, _: f"{value:g}")


def small(value: float) -> str:
    """A number of any size in two digits, or `-` if there is none."""
    return "-" if math.isnan(value) else f"{value:.1e}".replace("e-0", "e-")


def milliseconds(seconds: float) -> str:
    """A time in ms."""
    return f"{1e3 * seconds:.3g}"
