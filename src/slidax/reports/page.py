"""Self-contained HTML pages from templates."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from slidax._writing import write_text

from .machine import machine, versions
from .numbers import significant, typeset


def write_page(out: Path, template: str, *, data: Mapping[str, Any] | None = None, **values: Any) -> Path:
    """Write a page to `out/report.html` and its `data` as JSON to files by name in `out`; return the page's path.

    - `template`, `values`: as for `render`; versions and machine are added.
    """
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
    loaders = [PackageLoader(package) for package in (*packages, "slidax.reports")]
    environment = Environment(
        loader=ChoiceLoader(loaders), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["typeset"] = typeset
    environment.filters["number"] = _number
    environment.filters["numbers"] = _numbers
    # A long name may break at an underscore.
    environment.filters["breakable"] = lambda name: name.replace("_", "_\u200b")
    return environment.get_template(template).render(values)


def _number(value: float | None, digits: int = 3) -> Markup:
    return typeset(significant(value, digits))


def _numbers(values: Sequence[float | None], digits: int = 3) -> Markup:
    """A list in prose: "1.2, 3.4 and 5.6"."""
    words = [_number(value, digits) for value in values]
    return words[0] if len(words) == 1 else Markup("{} and {}").format(Markup(", ").join(words[:-1]), words[-1])
