"""From a Figure to a small SVG that looks the same everywhere."""

from __future__ import annotations

import io
import re
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from slidax._writing import replacing, write_text

from .style import STYLE

PATH_DATA = re.compile(r'(?<=\sd=")[^"]*')
PLACE = re.compile(r'(?<=\s[xy]=")[^"]*')
LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")
IDENTIFIER = re.compile(r'(\bid="|href="#|url\(#)')
NEXT_POINT = re.compile(r"\s+L\s+")
PROLOG = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
NAMESPACE = re.compile(r'\sxmlns(:\w+)?="[^"]*"')


def to_svg(figure: Figure, name: str) -> str:
    """The picture as an SVG document: text as paths, coordinates to a hundredth of a point, the same bytes every time.

    - `figure`: the picture.
    - `name`: put before each of its ids, so that several pictures fit into one page.
    """
    buffer = io.StringIO()
    with rc_context(STYLE | {"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg")
    text = METADATA.sub("", buffer.getvalue())
    text = IDENTIFIER.sub(lambda match: f"{match[1]}{name}-", text)
    text = PLACE.sub(lambda number: LONG_NUMBER.sub(_rounded, number[0]), text)
    return PATH_DATA.sub(lambda data: _shortened(data[0]), text)


def inline(svg: str) -> str:
    """The SVG document without what only a file of its own needs, for use inside a page.

    - `svg`: what `to_svg` returned.
    """
    return NAMESPACE.sub("", PROLOG.sub("", svg)).strip()


def save(figure: Figure, path: Path | str) -> Path:
    """Writes the picture; the ending of the path says in which format: svg, pdf, png.

    - `figure`: the picture.
    - `path`: where to; its folder is made if missing.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".svg":
        write_text(path, to_svg(figure, path.stem))
    else:
        ending = path.suffix.removeprefix(".") or "png"
        with rc_context(STYLE), replacing(path) as file:
            figure.savefig(file, format=ending)
    return path


def _shortened(data: str) -> str:
    """Points after the first of a polygon need no letter; where there are curves they do."""
    data = LONG_NUMBER.sub(_rounded, data)
    return data if set("QC") & set(data) else NEXT_POINT.sub(" ", data)


def _rounded(match: re.Match[str]) -> str:
    return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")
