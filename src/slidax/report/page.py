"""One self-contained HTML page from a template, with its figures, provenance and typeset numbers."""

from __future__ import annotations

import json
import math
import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from slidax import __version__
from slidax.core.writing import write_text

from .figures.style import dark_rules, inline_svg, to_svg

POWER_OF_TEN = re.compile(r"(?<![\w.])(-?\d+(?:\.\d+)?)e([+-]?\d+)(?![\w.])")
SUBSCRIPT = re.compile(r"(?<!\w)(\w)_(\w+)")
MINUS = re.compile(r"(?<![\w.\-])-(?=\d)")
UNIT = re.compile(r"(?<=\d) (?=(?:%|k?Hz\b|[mµ]?s\b|rad\b|kg\b|N\b|m\b))")
MAGNITUDE = re.compile(r"(\|[^|\s]{1,12}\|)")


def significant(number: float | None, digits: int = 4) -> str:
    """Format a `number` with `digits` significant digits as plain text; "–" for None and non-finite values."""
    if number is None or not math.isfinite(number):
        return "–"
    if number == 0:
        return "0"
    mantissa, exponent = f"{number:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -3 <= power < 4:
        return f"{float(f'{mantissa}e{power}'):.{max(0, digits - 1 - power)}f}"
    return f"{mantissa}e{power}"


def typeset(text: object) -> Markup:
    """Return a plain `text` as HTML: raised powers of ten, `T_max` with subscript, code in backticks, and ≤, ≥ and −.

    A line never breaks before a unit or within `|x|`. HTML in the text is escaped; Markup passes unchanged.
    """
    if isinstance(text, Markup):
        return text
    # Every other piece is code in backticks.
    pieces = str(escape(text)).split("`")
    if len(pieces) % 2 == 0:
        return Markup(_set("`".join(pieces)))
    return Markup("".join(f"<code>{piece}</code>" if k % 2 else _set(piece) for k, piece in enumerate(pieces)))


def _set(safe: str) -> str:
    safe = safe.replace("&lt;=", "≤").replace("&gt;=", "≥")
    safe = SUBSCRIPT.sub(r"\1<sub>\2</sub>", POWER_OF_TEN.sub(_raised, safe)).replace("N m", "N\u00a0m")
    safe = MAGNITUDE.sub(r'<span class="whole">\1</span>', UNIT.sub("\u00a0", safe))
    return MINUS.sub("−", safe)


def _raised(match: re.Match[str]) -> str:
    mantissa, exponent = match.groups()
    power = f"10<sup>{int(exponent)}</sup>".replace("-", "−")
    return power if mantissa == "1" else f"{mantissa}\u00a0×\u00a0{power}"


PACKAGES = ("jax", "jaxlib", "equinox", "numpy", "matplotlib")


def versions() -> dict[str, str]:
    """Return the versions of Python, slidax and the packages that compute or draw, by name."""
    return {"slidax": __version__, "Python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def machine() -> dict[str, str]:
    """Return CPU model, number of cores and operating system, as text by name."""
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count() or "unknown"),
        "system": f"{platform.system()} on {platform.machine()}",
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def write_page(out: str | Path, template: str, *, data: Mapping[str, Any] | None = None, **values: Any) -> Path:
    """Write a page to `out/report.html` and its `data` to JSON files in `out`; return the page's path.

    - `data`: contents of the JSON files, by file name.
    - `template`, `values`: as for `render`; versions and machine are added.
    """
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    for name, content in (data or {}).items():
        write_text(out / name, json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n")
    page = out / "report.html"
    write_text(page, render(template, {"versions": versions(), "machine": machine(), **values}))
    return page


def render(template: str, values: dict[str, Any], packages: Sequence[str] = ()) -> str:
    """Return the text of a page.

    - `template`: a name such as `run.html.j2`; it extends `page.html.j2`.
    - `values`: variables of the template; text in them is escaped.
    - `packages`: packages with a folder `templates`, searched before this one.
    """
    loaders = [PackageLoader(package) for package in (*packages, "slidax.report")]
    environment = Environment(
        loader=ChoiceLoader(loaders), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["typeset"] = typeset
    environment.filters["number"] = _number
    environment.filters["numbers"] = _numbers
    # A long name may break at an underscore.
    environment.filters["breakable"] = lambda name: name.replace("_", "_\u200b")
    return environment.get_template(template).render(values, dark_figures=Markup(dark_rules("figure svg")))


def _number(value: float | None, digits: int = 3) -> Markup:
    return typeset(significant(value, digits))


def _numbers(values: Sequence[float | None], digits: int = 3) -> Markup:
    """Format a list in prose: "1.2, 3.4 and 5.6"."""
    words = [_number(value, digits) for value in values]
    return words[0] if len(words) == 1 else Markup("{} and {}").format(Markup(", ").join(words[:-1]), words[-1])


@dataclass(frozen=True)
class Picture:
    """A figure with its caption, ready for a page.

    - `name`: name of the SVG file, without ending.
    - `title`: a few words before the `caption`, such as "Fig. 3".
    - `svg`: the figure.
    - `width`: its natural width [in].
    """

    name: str
    title: str
    caption: str
    svg: Markup
    width: float


def picture(figure: Figure, folder: str | Path, name: str, title: str, caption: str) -> Picture:
    """Write a `figure` to `folder/name.svg` and return it with `title` and `caption` (plain text) for a page."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    svg = to_svg(figure, name)
    write_text(folder / f"{name}.svg", svg)
    return Picture(name, title, caption, Markup(inline_svg(svg)), float(figure.get_figwidth()))
