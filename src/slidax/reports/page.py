"""From a template and its values to one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from .numbers import significant, typeset


def render(template: str, values: dict[str, Any], packages: Sequence[str] = ()) -> str:
    """The page as text.

    - `template`: its name, such as `run.html.j2`; it extends `page.html.j2`.
    - `values`: what the template names; all text in it is escaped.
    - `packages`: packages with a folder `templates`, searched before this one.
    """
    loaders = [PackageLoader(package) for package in (*packages, "slidax.reports")]
    environment = Environment(
        loader=ChoiceLoader(loaders), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["typeset"] = typeset
    environment.filters["number"] = _number
    environment.filters["numbers"] = _numbers
    # So that a long name may end its line at an underscore.
    environment.filters["breakable"] = lambda name: name.replace("_", "_\u200b")
    return environment.get_template(template).render(values)


def _number(value: float | None, digits: int = 3) -> Markup:
    return typeset(significant(value, digits))


def _numbers(values: Sequence[float | None], digits: int = 3) -> Markup:
    """A list in prose: "1.2, 3.4 and 5.6"."""
    words = [_number(value, digits) for value in values]
    return words[0] if len(words) == 1 else Markup("{} and {}").format(Markup(", ").join(words[:-1]), words[-1])
