"""Typeface, colours, axes, thinning and SVG output that all figures share."""

from __future__ import annotations

import functools
import io
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from slidax.analysis.metric import short_names
from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError
from slidax.core.writing import replace_file, write_text
from slidax.simulation.run import Log, Run

Given = ParamSpec("Given")
Drawn = TypeVar("Drawn")


class NotebookFigure(Figure):
    """A Figure that a notebook shows as SVG, with the settings that it was drawn with."""

    settings: Any

    def _repr_svg_(self) -> str:
        buffer = io.StringIO()
        with rc_context(self.settings):
            self.savefig(buffer, format="svg")
        return buffer.getvalue()


def drawn_by(settings: Any) -> Callable[[Callable[Given, Drawn]], Callable[Given, Drawn]]:
    """Return a decorator that runs a drawing function with matplotlib's `settings` and makes its figure notebook-ready.

    A notebook shows the returned figure as SVG.
    """

    def decorated(draw: Callable[Given, Drawn]) -> Callable[Given, Drawn]:
        @functools.wraps(draw)
        def drawn(*args: Given.args, **kwargs: Given.kwargs) -> Drawn:
            with rc_context(settings):
                figure: Any = draw(*args, **kwargs)
            if isinstance(figure, Figure):
                # Every figure passes here, so the functions that draw need no code for it.
                figure.__class__ = NotebookFigure
                figure.settings = settings  # type: ignore[attr-defined]
            return figure

        return drawn

    return decorated


STYLE: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.edgecolor": "0.25",
    "axes.linewidth": 0.6,
    "axes.labelcolor": "0.1",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.xmargin": 0.0,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "xtick.color": "0.25",
    "ytick.color": "0.25",
    "xtick.labelcolor": "0.1",
    "ytick.labelcolor": "0.1",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "lines.dash_capstyle": "butt",
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "legend.columnspacing": 1.8,
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
    "svg.fonttype": "path",
    "figure.dpi": 100.0,
    "savefig.dpi": 200.0,
}
"""Settings of matplotlib while a figure is drawn. Text becomes paths in an SVG, so that it looks the same where the
typeface is missing.
"""

WIDTH = 6.9
"""Width of a figure over two columns of a journal [in]."""

SMALL = 4.9
"""Width of a figure that can be read as a whole on a phone [in]."""

ROW = 1.45
"""Height of one joint's row [in]."""

LINES: tuple[dict[str, Any], ...] = (
    {"color": "#0072B2", "linestyle": "-"},
    {"color": "#D55E00", "linestyle": (0, (5, 1.6))},
    {"color": "#009E73", "linestyle": (0, (1.2, 1.2))},
    {"color": "#7B3294", "linestyle": (0, (5, 1.4, 1.2, 1.4))},
    {"color": "#000000", "linestyle": (0, (3, 1.2, 1.2, 1.2, 1.2, 1.2))},
)
"""Colour and dashes of the first, second, ... line, distinct without colour too. After Okabe and Ito."""

BAND: dict[str, Any] = {"facecolor": "#E9EEF4", "edgecolor": "none"}
"""The inside of an envelope."""

BOUND: dict[str, Any] = {"color": "#6B7785", "linewidth": 0.8}
"""The edge of an envelope."""

NARROW: dict[str, Any] = {**BOUND, "linewidth": 0.6, "linestyle": (0, (4, 2))}
"""The narrower side of an envelope."""

LIMIT: dict[str, Any] = {"color": "#A33B20", "linewidth": 0.7, "linestyle": (0, (6, 2, 1, 2))}
"""A limit of the drives."""

styled = drawn_by(STYLE)
"""Decorator of functions that draw with `STYLE`; a notebook shows their figures."""


def envelope_patch(label: str = "envelope") -> Patch:
    """Return the legend entry of an envelope, with a `label`."""
    return Patch(facecolor=BAND["facecolor"], edgecolor=BOUND["color"], linewidth=BOUND["linewidth"], label=label)


def legend_above(figure: Figure, handles: Sequence[Artist], columns: int | None = None) -> None:
    """Add one legend above all panels of a `figure`, in `columns` (default: one row), with `handles`."""
    figure.legend(handles=handles, loc="outside upper center", ncols=columns or len(handles))


def use_time_axis(axes: Axes, start: float, end: float) -> None:
    """Label time from `start` to `end` [s] on `axes`; a gap before the start keeps steep beginnings visible."""
    axes.set_xlabel(r"$t$  [s]")
    axes.set_xlim(start - 0.012 * (end - start), end)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))


def use_size_axis(panels: Iterable[Axes], sizes: np.ndarray) -> None:
    """Set the same logarithmic y-axis in whole decades for all `panels`, to show nearly all `sizes` (>= 0).

    The absolute value of an error is tiny while the error crosses zero. The lowest 2 % may be below the axis.
    """
    positive = sizes[np.isfinite(sizes) & (sizes > 0)]
    if not len(positive):
        positive = np.array([1e-3, 1.0])
    high = int(np.ceil(np.log10(positive.max()) + 0.02))
    low = min(int(np.floor(np.log10(np.quantile(positive, 0.02)))), high - 2)
    for axes in panels:
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(10.0**low, 10.0**high)
        axes.yaxis.set_major_locator(LogLocator(base=10.0 ** max(1, round((high - low) / 5)), numticks=12))
        axes.yaxis.set_minor_locator(LogLocator(base=10.0, numticks=40))
        axes.yaxis.set_minor_formatter(NullFormatter())


def use_plain_ticks(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic `axis` from `low` to `high` with plain numbers, unless it spans three decades or more."""
    if high < 1e3 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


NEAR = 0.4
"""The panel includes the torque limit if a torque exceeds this share of the limit."""


def draw_limit(panels: Iterable[Axes], limit: float, unit: str) -> None:
    """Draw a line at each torque limit, and its value above the first panel.

    Far above the torque, the lines lie outside the axes, so that the torque stays visible.

    - `panels`: panels of one joint, with the torques drawn.
    - `limit`: largest torque [N m or N]; nothing is drawn if it is infinite.
    - `unit`: unit of the limit, for the text.
    """
    if not np.isfinite(limit):
        return
    panels = list(panels)
    for axes in panels:
        low, high = axes.get_ylim()
        gap = 0.07 * limit
        for end in (-limit, limit):
            axes.axhline(end, **LIMIT, zorder=1.7)
        if high > NEAR * limit:
            high = max(high, limit + gap)
        if -low > NEAR * limit:
            low = min(low, -limit - gap)
        axes.set_ylim(low, high)
    panels[0].set_title(f"limit ±{limit:g} {unit}", loc="right", fontsize=7.5, color=LIMIT["color"], pad=2.5)


def limit_handle() -> Line2D:
    """Return the legend entry of the torque limits."""
    return Line2D([], [], **LIMIT, label="torque limit")


LONGEST = 18
"""Largest number of characters of a joint's name in a label."""


def log_of(run: Run) -> Log:
    """Return the log of a `run`.

    Raises DefinitionError if there is no log, the log is too short, or the run is a batch.
    """
    if run.log is None:
        raise DefinitionError("this run has no log, which a figure needs: simulate with `log_every=10`, not None")
    if np.ndim(run.log.t) != 1:
        raise DefinitionError("a figure shows a single run, and this is a batch: take one run, such as `runs[0]`")
    if len(run.log.t) < 2:
        raise DefinitionError(f"a figure needs at least two logged samples; got {len(run.log.t)}: reduce `log_every`")
    return run.log


def joint_label(run: Run | AbstractRobot, joint: int, symbol: str, unit: str) -> str:
    """Return the axis label of a joint: its name, if it has one, above the symbol with its number.

    - `run`: run or arm with the joint.
    - `joint`: index from 0.
    - `symbol`: mathematical text with `%d` for the number.
    """
    name = short_names(run.joint_names)[joint]
    label = f"${symbol % (joint + 1)}$  [{unit}]"
    if name == f"joint {joint + 1}":
        return label
    shown = name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"
    return f"{shown.replace('$', '')}\n{label}"


HEIGHTS = 450
"""A thinned curve may be off by 1/`HEIGHTS` of its panel's height, less than half its line width."""


def thin_curve(
    x: np.ndarray, y: np.ndarray, columns: int = 280, limits: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the visible points of a curve: the first, last, lowest and highest in each of several equal intervals.

    No peak is lost. With known axis limits, points on a straight line between others are removed, too.

    - `x`: increasing [k].
    - `y`: values as the axis shows them, that is, logarithms on a logarithmic axis [k].
    - `columns`: number of intervals.
    - `limits`: limits of the axis of `y`.
    """
    if len(x) > 4 * columns:
        starts = column_starts(x, columns)
        ends = np.append(starts[1:], len(x))
        keep = [starts, ends - 1]
        for pick in (np.argmin, np.argmax):
            keep.append(np.array([start + int(pick(y[start:end])) for start, end in zip(starts, ends, strict=True)]))
        chosen = np.unique(np.concatenate(keep))
        x, y = x[chosen], y[chosen]
    if limits is not None:
        kept = _off_lines(x, y, (limits[1] - limits[0]) / HEIGHTS)
        x, y = x[kept], y[kept]
    return x, y


def column_starts(t: np.ndarray, columns: int) -> np.ndarray:
    """Divide increasing times `t` [k] into `columns` equal intervals; return the first index of each nonempty one."""
    column = np.minimum(((t - t[0]) * (columns / (t[-1] - t[0]))).astype(int), columns - 1)
    return np.flatnonzero(np.diff(column, prepend=-1))


def every_nth(points: np.ndarray, most: int = 160) -> np.ndarray:
    """Return about `most` of the `points` (along the first axis) of a smooth curve, with the first and the last."""
    chosen = np.unique(np.linspace(0, len(points) - 1, min(most, len(points))).round().astype(int))
    return points[chosen]


def off_lines(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Return a mask [k] of the points to keep in a simplified polyline, by Douglas and Peucker's algorithm (1973).

    - `points`: vertices of the polyline [k 2].
    - `tolerance`: largest distance of a removed point from the simplified polyline.
    """
    keep = np.zeros(len(points), bool)
    keep[[0, -1]] = True
    open_ends = [(0, len(points) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        offsets, line = points[first + 1 : last] - points[first], points[last] - points[first]
        share = np.clip(offsets @ line / max(float(line @ line), 1e-300), 0.0, 1.0)
        distance = np.linalg.norm(offsets - share[:, None] * line, axis=1)
        farthest = int(np.argmax(distance))
        if distance[farthest] > tolerance:
            middle = first + 1 + farthest
            keep[middle] = True
            open_ends += [(first, middle), (middle, last)]
    return keep


def _off_lines(x: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """Return a mask of the points to keep; a polyline through these misses no other by over `tolerance` in y."""
    keep = np.zeros(len(x), bool)
    keep[[0, -1]] = True
    open_ends = [(0, len(x) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        off = np.abs(y[inner] - np.interp(x[inner], x[[first, last]], y[[first, last]]))
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            open_ends += [(first, middle), (middle, last)]
    return keep


PATH_DATA = re.compile(r'(?<=\sd=")[^"]*')
PLACE = re.compile(r'(?<=\s[xy]=")[^"]*')
LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")
NUMBER = re.compile(r"-?[\d.]+")
IDENTIFIER = re.compile(r'(\bid="|href="#|url\(#)')
COMMENT = re.compile(r"\s*<!--.*?-->", re.DOTALL)
GROUP_ID = re.compile(r'(?<=<g) id="(?![^"]*-figure_1")[^"]*"')
BARE_GROUP = re.compile(r"<g>\s*((?:<(?:use|path)\b[^>]*/>\s*)*)</g>")
GLYPH = re.compile(r"STIX\w*-(\w)\w*-")
SHIFTED = re.compile(r'transform="translate\((\S+) 0\)"/>')
TRANSLATION = re.compile(r"(?<=translate\()[^)]*")
TICK = re.compile(r'<path id="([^"]+)" d="M0 0l[^ "]+ ?[^ "z]+" style=')
TOLERANCE = 0.2
"""A curve may be off by this much: less than a quarter of its line width [pt]."""
PROLOG = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
NAMESPACE = re.compile(r'\sxmlns(:\w+)?="[^"]*"')


DARK = {
    "#ffffff": "#15191e",
    "#1a1a1a": "#e4e8ec",
    "#000000": "#e4e8ec",
    "#333333": "#cdd4db",
    "#404040": "#aab4be",
    "#4c4c4c": "#b8c2cc",
    "#737373": "#9aa5b0",
    "#6b7785": "#8b98a6",
    "#b2b2b2": "#6a737d",
    "#bfbfbf": "#5a636d",
    "#e6e6e6": "#2d343c",
    "#e9eef4": "#1f2a36",
    "#c9d8e8": "#33465a",
    "#0072b2": "#4aa8e0",
    "#d55e00": "#ff8a3d",
    "#009e73": "#35c79a",
    "#7b3294": "#c98ae6",
    "#a33b20": "#ff8f73",
    "#c00000": "#ff7070",
    "#a50f15": "#ff7b7b",
    "#00594c": "#3fb8a2",
    "#7a5230": "#c08a5a",
    "#8c8c00": "#c2c23a",
}
"""Colours on a dark page, by the colours on a light page. A white background becomes transparent in `dark_rules`."""


def dark_rules(scope: str = "svg") -> str:
    """Return CSS rules that give figures the colours of a dark page if the reader's system uses dark mode.

    - `scope`: CSS selector of the figures, for the colour of their text.
    """
    # Without the scope: markers are drawn in shadow trees, which have no figure as an ancestor.
    rules = [
        f'[style*="{place}:{light}"]{{{place}:{"transparent" if light == "#ffffff" else dark}!important}}'
        for light, dark in DARK.items()
        for place in ("fill", "stroke")
    ]
    # Black text has no colour of its own in matplotlib's files, and a hatch has its background in an attribute.
    rules = [f"{scope}{{fill:{DARK['#000000']}}}", f"{scope} pattern rect{{fill:transparent}}", *rules]
    return f"@media screen and (prefers-color-scheme:dark){{{''.join(rules)}}}"


def to_svg(figure: Figure, name: str) -> str:
    """Return a `figure` as an SVG document: text as paths, coordinates to a hundredth of a point, reproducible bytes.

    Its colours follow the reader's system, light or dark.

    - `name`: prefix of the SVG's ids, so that several figures fit into one page.
    """
    buffer = io.StringIO()
    with rc_context(STYLE | {"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg")
    text = METADATA.sub("", buffer.getvalue())
    text = IDENTIFIER.sub(lambda match: f"{match[1]}{name}-", text)
    return _compact(text).replace("</style>", f"{dark_rules()}</style>", 1)


def inline_svg(svg: str) -> str:
    """Return an SVG of `to_svg` without prolog, namespaces and dark-mode rules; a page has these once for all."""
    return NAMESPACE.sub("", PROLOG.sub("", svg)).replace(dark_rules(), "").strip()


def save(figure: Figure, path: Path | str) -> Path:
    """Write a `figure` to `path`, whose suffix is the format: svg, pdf or png; return the path."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".svg":
        write_text(path, to_svg(figure, path.stem))
    else:
        ending = path.suffix.removeprefix(".") or "png"
        with rc_context(STYLE), replace_file(path) as file:
            figure.savefig(file, format=ending)
    return path


def _compact(text: str) -> str:
    """Shrink the text of an SVG: round numbers, and remove unused ids and groups."""
    for numbers in (PLACE, TRANSLATION):
        text = numbers.sub(lambda match: LONG_NUMBER.sub(_rounded, match[0]), text)
    text = GROUP_ID.sub("", COMMENT.sub("", text))
    count = 1
    while count:
        text, count = BARE_GROUP.subn(r"\1", text)
    text = SHIFTED.sub(r'x="\1"/>', GLYPH.sub(r"\1", text))
    text = PATH_DATA.sub(lambda match: _shortened(match[0]), text)
    for tick in TICK.findall(text):
        # A line has no fill, and its definition has the stroke.
        text = re.sub(rf'(<use xlink:href="#{tick}"[^>]*?) style="[^"]*"', r"\1", text)
    return re.sub(r"\s*\n\s*", "\n", text).replace("; ", ";").replace(": ", ":")


def _shortened(data: str) -> str:
    """Shrink path data: polygons get relative coordinates, without points on straight lines; curves get rounded."""
    data = LONG_NUMBER.sub(_rounded, data)
    if set("QC") & set(data):
        return data
    parts = []
    for part in re.findall(r"M[^M]*", data):
        points = np.array(NUMBER.findall(part), dtype=float).reshape(-1, 2)
        points = points[off_lines(points, TOLERANCE)].round(2)
        x, y = points[0]
        steps = " ".join(f"{_number(dx)} {_number(dy)}" for dx, dy in np.diff(points, axis=0).round(2))
        parts.append(f"M{_number(x)} {_number(y)}{'l' * bool(steps)}{steps}{'z' * ('z' in part)}".replace(" -", "-"))
    return "".join(parts)


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".").replace("-0.", "-.").removeprefix("0") or "0"


def _rounded(match: re.Match[str]) -> str:
    return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")
