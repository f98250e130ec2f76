"""Small SVG files that look the same everywhere."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from slidax._writing import replacing, write_text

from .style import STYLE
from .thinning import off_lines

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


def to_svg(figure: Figure, name: str) -> str:
    """A `figure` as an SVG document: text as paths, coordinates to a hundredth of a point, reproducible bytes.

    - `name`: prefix of its ids, so that several figures fit into one page.
    """
    buffer = io.StringIO()
    with rc_context(STYLE | {"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg")
    text = METADATA.sub("", buffer.getvalue())
    text = IDENTIFIER.sub(lambda match: f"{match[1]}{name}-", text)
    return _compact(text)


def inline(svg: str) -> str:
    """An SVG document from `to_svg` without its prolog and namespaces, for use inside a page."""
    return NAMESPACE.sub("", PROLOG.sub("", svg)).strip()


def save(figure: Figure, path: Path | str) -> Path:
    """Write a `figure` to `path`, whose ending is the format: svg, pdf, png."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".svg":
        write_text(path, to_svg(figure, path.stem))
    else:
        ending = path.suffix.removeprefix(".") or "png"
        with rc_context(STYLE), replacing(path) as file:
            figure.savefig(file, format=ending)
    return path


def _compact(text: str) -> str:
    """The same picture with fewer bytes: rounded, without ids and groups that nothing needs."""
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
    """Polygons with relative coordinates and without the points on straight lines; curves are only rounded."""
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
