"""A figure with its caption, for a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from slidax._writing import write_text
from slidax.figures import inline, to_svg


@dataclass(frozen=True)
class Picture:
    """A figure with its caption, ready for a page.

    - `name`: of the SVG file, without ending.
    - `title`: a few words before the `caption`, such as "Fig. 3".
    - `svg`: the figure.
    - `width`: its natural width [in].
    """

    name: str
    title: str
    caption: str
    svg: Markup
    width: float


def picture(figure: Figure, folder: Path, name: str, title: str, caption: str) -> Picture:
    """Write a `figure` to `folder/name.svg` and return it with `title` and `caption` (plain text) for a page."""
    folder.mkdir(parents=True, exist_ok=True)
    svg = to_svg(figure, name)
    write_text(folder / f"{name}.svg", svg)
    return Picture(name, title, caption, Markup(inline(svg)), float(figure.get_figwidth()))
