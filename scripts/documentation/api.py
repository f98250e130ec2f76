"""The pages of the API: which names there are, and what only a running slidax knows of them.

Signatures, docstrings and methods are read from the sources by mkdocstrings. Declared parameters, the numbers of
presets and the units of metrics are not in any docstring; they are written down as facts, which `griffe_facts` adds.
"""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

from .tables import table

HEAD = ["parameter", "meaning", "unit", "range", "default", "source"]


def rooms() -> list[str]:
    """All rooms but the command line, which explains itself by `slidax --help`."""
    import slidax

    return sorted({path.parent.name for path in Path(slidax.__file__).parent.glob("*/__init__.py")} - {"cli"})


def exported(module: Any) -> list[tuple[str, Any]]:
    """The public classes, functions, presets and metrics of a package, in the order of its exports.

    - `module`: the package.
    """
    text = Path(module.__file__).read_text(encoding="utf-8")
    listed = getattr(module, "__all__", re.findall(r"^from \S+ import \w+ as (\w+)", text, re.MULTILINE))
    found = [(name, getattr(module, name)) for name in listed]
    return [(name, thing) for name, thing in found if callable(thing) and not name.startswith("_")]


def pages() -> tuple[dict[str, str], dict[str, str]]:
    """The pages by their place on the site, and the facts by the full names of what they are about."""
    import slidax

    made: dict[str, str] = {}
    facts: dict[str, str] = {}
    lines = ["# The API of slidax", "", slidax.__doc__ or "", "", "| room | what is in it |", "|---|---|"]
    for room in rooms():
        made[f"api/{room}.md"] = _page(room, facts)
        first = (importlib.import_module(f"slidax.{room}").__doc__ or "").partition("\n")[0].replace("|", "\\|")
        lines.append(f"| [`slidax.{room}`]({room}.md) | {first} |")
    made["api/index.md"] = "\n".join([*lines, ""])
    return made, facts


def _page(room: str, facts: dict[str, str]) -> str:
    module = importlib.import_module(f"slidax.{room}")
    found = [(f"slidax.{room}", name, thing) for name, thing in exported(module)]
    # A room of whole packages has a page of what they export.
    for inner in sorted(Path(module.__file__ or "").parent.glob("*/__init__.py")) if not found else ():
        package = f"slidax.{room}.{inner.parent.name}"
        found += [(package, name, thing) for name, thing in exported(importlib.import_module(package))]
    rows, sections = [], []
    for package, name, thing in found:
        said = _facts(thing)
        if said:
            # A reader of the sources knows it by the module that defines it.
            facts[_defined(package, name)] = said
        first = _first(thing).replace("|", "\\|")
        # Where a module has the name of what it defines, the reader of the sources would take the module.
        path = _defined(package, name) if _is_module(package, name) else f"{package}.{name}"
        rows.append(f"| [`{name}`](#{path}) | {first} |")
        sections.append(f"::: {path}\n")
    head = [f"# slidax.{room}", "", inspect.getdoc(module) or "", "", "| name | what it is |", "|---|---|"]
    return "\n".join([*head, *rows, "", *sections])


def _is_module(package: str, name: str) -> bool:
    folder = Path(importlib.import_module(package).__file__ or "").parent
    return (folder / f"{name}.py").exists() or (folder / name).is_dir()


def _defined(package: str, name: str) -> str:
    """The full name of an export where it is defined, which the package's own import says.

    - `package`: that exports it.
    - `name`: there.
    """
    while True:
        text = Path(importlib.import_module(package).__file__ or "").read_text(encoding="utf-8")
        line = re.search(rf"^from (\.?[\w.]+) import (\w+) as {name}$", text, re.MULTILINE)
        if line is None:
            return f"{package}.{name}"
        package = f"{package}{line[1]}" if line[1].startswith(".") else line[1]
        name = line[2]


def _first(thing: Any) -> str:
    from slidax.metrics import Metric

    doc = inspect.getdoc(thing) or ""
    return f"{thing.title}: {doc.partition(chr(10))[0]}" if isinstance(thing, Metric) else doc.partition("\n")[0]


def _facts(thing: Any) -> str:
    """What the sources do not show, as Markdown; empty if there is nothing.

    - `thing`: a class, a function, a preset or a metric.
    """
    from slidax.controllers import Preset
    from slidax.metrics import Metric
    from slidax.parts import AbstractPart, parameters_of

    if isinstance(thing, Preset):
        law = f"Law: `{thing.law.__name__}`."
        numbers = f" Numbers: {thing.source}." if thing.source else ""
        given = [f"- `{name}`: `{value}`" for name, value in thing.given.items()]
        return "\n".join([thing.__doc__ or "", "", law + numbers, "", *given])
    if isinstance(thing, Metric):
        unit = thing.unit.format(position="rad or m", torque="N m or N") or "none"
        return f"Key in `slidax run --json`: `{thing.key}`. Unit: {unit}. " + (
            "One value per joint." if thing.per_joint else "One value for the run."
        )
    if inspect.isclass(thing) and issubclass(thing, AbstractPart):
        rows = [_row(one) for one in parameters_of(thing) if one.meaning]
        return table(HEAD, rows) if rows else ""
    return ""


def _row(one: Any) -> list[str]:
    default = "must be given" if one.required else "" if one.default in (None, ()) else _shown(one.default)
    shape = f" ({one.shape})" if one.shape else ""
    return [f"`{one.name}`", f"{one.meaning}{shape}", one.unit, one.limits, default, one.source]


def _shown(default: Any) -> str:
    if isinstance(default, float):
        return f"{default:g}"
    text = getattr(default, "__name__", None) or str(default)
    return text if "<" not in text and len(text) < 40 else "a part"


def parameters_page() -> str:
    """All that a scenario file may have, part by part: the tables of `slidax list NAME`."""
    from slidax.scenarios import catalogue, explained

    lines = [
        "# Parameters of scenario files",
        "",
        "Every part that a [scenario file](../scenarios.md) can name, with its numbers. `slidax list NAME` shows the"
        " same in a terminal, and `slidax list NAME --json` for programs.",
    ]
    for kind, members in catalogue().items():
        if kind == "scenarios":
            continue
        lines += ["", f"## {kind}", ""]
        for name, first in members.items():
            part = explained(f"{kind}.{name}")
            lines += [f"### `{name}` {{ #{kind}.{name} }}", "", f"{first}", ""]
            rows = [
                [
                    f"`{row['path']}`",
                    row["meaning"],
                    row["unit"] or "",
                    row["range"] or "",
                    "must be given"
                    if row["required"]
                    else _shown(row["default"])
                    if row["default"] not in (None, {}, [], ())
                    else "",
                    row["source"] or "",
                ]
                for row in part["parameters"]
            ]
            lines += [table(HEAD, rows) if rows else "It has no numbers.", ""]
    return "\n".join([*lines, ""])
