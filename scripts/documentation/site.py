"""Build the site as a whole: the reference of its API, and the check of its links."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urldefrag, urlsplit

from .pages import run_all
from .stage import ROOT, Stage, with_gallery, with_playground, with_results


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table; columns in which nothing stands are left out."""
    kept = [k for k in range(len(head)) if k == 0 or any(row[k] for row in rows)]
    lines = [[head[k] for k in kept], ["---"] * len(kept)]
    lines += [[row[k].replace("|", "\\|").replace("\n", " ") for k in kept] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


GROUPS = {
    "Robot and motion": ("arms", "motions", "plant", "identify"),
    "Controllers": ("law", "design"),
    "Simulate and measure": ("simulation", "scenarios", "analysis", "report", "paper"),
    "Certify and study": ("certify", "studies"),
    "Deploy": ("export", "runtime", "studio"),
    "Internals": ("core", "codegen"),
}
"""Subpackages in the table of contents of the API."""

HEAD = ["parameter", "meaning", "unit", "range", "default", "source"]


def rooms() -> list[str]:
    """All rooms but the command line, which explains itself by `slidax --help`."""
    import slidax

    return sorted({path.parent.name for path in Path(slidax.__file__).parent.glob("*/__init__.py")} - {"cli"})


def exported(module: Any) -> list[tuple[str, Any]]:
    """The public classes, functions, presets and metrics of a package, in the order of its exports."""
    text = Path(module.__file__).read_text(encoding="utf-8")
    listed = getattr(module, "__all__", re.findall(r"^from \S+ import \w+ as (\w+)", text, re.MULTILINE))
    things = [(name, getattr(module, name)) for name in listed]
    return [(name, thing) for name, thing in things if callable(thing) and not name.startswith("_")]


def api_pages() -> tuple[dict[str, str], dict[str, str]]:
    """The pages by their place on the site, and the facts by the full names of what they are about."""
    import slidax

    texts: dict[str, str] = {}
    facts: dict[str, str] = {}
    lines = ["# The API of slidax", "", slidax.__doc__ or "", "", "| room | what is in it |", "|---|---|"]
    for room in rooms():
        texts[f"api/{room}.md"] = _page(room, facts)
        first = (importlib.import_module(f"slidax.{room}").__doc__ or "").partition("\n")[0].replace("|", "\\|")
        lines.append(f"| [`slidax.{room}`]({room}.md) | {first} |")
    texts["api/index.md"] = "\n".join([*lines, ""])
    return texts, facts


def _page(room: str, facts: dict[str, str]) -> str:
    module = importlib.import_module(f"slidax.{room}")
    things = [(f"slidax.{room}", name, thing) for name, thing in exported(module)]
    # A room of whole packages has a page of what they export.
    for inner in sorted(Path(module.__file__ or "").parent.glob("*/__init__.py")) if not things else ():
        package = f"slidax.{room}.{inner.parent.name}"
        things += [(package, name, thing) for name, thing in exported(importlib.import_module(package))]
    rows, sections = [], []
    for package, name, thing in things:
        fact = _facts(thing)
        if fact:
            # A reader of the sources knows it by the module that defines it.
            facts[_defined(package, name)] = fact
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
    """The full name of an export where it is defined, which the package's own import says."""
    while True:
        text = Path(importlib.import_module(package).__file__ or "").read_text(encoding="utf-8")
        line = re.search(rf"^from (\.?[\w.]+) import (\w+) as {name}$", text, re.MULTILINE)
        if line is None:
            return f"{package}.{name}"
        package = f"{package}{line[1]}" if line[1].startswith(".") else line[1]
        name = line[2]


def _first(thing: Any) -> str:
    from slidax.analysis import Metric

    doc = inspect.getdoc(thing) or ""
    return f"{thing.title}: {doc.partition(chr(10))[0]}" if isinstance(thing, Metric) else doc.partition("\n")[0]


def _facts(thing: Any) -> str:
    """Facts that the sources do not show, as Markdown; empty if there are none.

    - `thing`: a class, a function, a preset or a metric.
    """
    from slidax.analysis import Metric
    from slidax.core import AbstractPart, parameters_of
    from slidax.law import Preset

    if isinstance(thing, Preset):
        law = f"Law: `{thing.law.__name__}`."
        numbers = f" Numbers: {thing.source}." if thing.source else ""
        presets = [f"- `{name}`: `{value}`" for name, value in thing.values.items()]
        return "\n".join([thing.__doc__ or "", "", law + numbers, "", *presets])
    if isinstance(thing, Metric):
        unit = thing.unit.format(position="rad or m", torque="N m or N") or "none"
        return f"Key in `slidax run --json`: `{thing.key}`. Unit: {unit}. " + (
            "One value per joint." if thing.per_joint else "One value for the run."
        )
    if inspect.isclass(thing) and issubclass(thing, AbstractPart):
        rows = [_row(declared) for declared in parameters_of(thing) if declared.meaning]
        return table(HEAD, rows) if rows else ""
    return ""


def _row(declared: Any) -> list[str]:
    default = (
        "must be given" if declared.required else "" if declared.default in (None, ()) else _shown(declared.default)
    )
    shape = f" ({declared.shape})" if declared.shape else ""
    return [
        f"`{declared.name}`",
        f"{declared.meaning}{shape}",
        declared.unit,
        declared.limits,
        default,
        declared.source,
    ]


def _shown(default: Any) -> str:
    if isinstance(default, float):
        return f"{default:g}"
    text = getattr(default, "__name__", None) or str(default)
    return text if "<" not in text and len(text) < 40 else "a part"


def parameters_page() -> str:
    """All that a scenario file may have, part by part: the tables of `slidax list NAME`."""
    from slidax.scenarios import catalogue, explain_parameters

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
            part = explain_parameters(f"{kind}.{name}")
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


FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "object": "data"}
STYLE = re.compile(r"(?:url\(\s*|@import\s+)[\"']?(https?:)?//", re.IGNORECASE)


@dataclass
class _Page(HTMLParser):
    """The links, anchors and fetched files of a page."""

    links: list[str] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)
    fetched: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        self.anchors |= {value for key in ("id", "name") if (value := attributes.get(key))}
        if tag == "a" and (href := attributes.get("href")) is not None:
            self.links.append(href)
        if tag == "link" and "canonical" not in (attributes.get("rel") or "") and (href := attributes.get("href")):
            self.fetched.append(href)
        if tag in FETCHED and (source := attributes.get(FETCHED[tag])):
            self.fetched.append(source)


@dataclass
class LinkReport:
    """Findings of a check of the site.

    - `broken`: what leads nowhere, with the page.
    - `foreign`: what is fetched from elsewhere, with the page.
    - `outward`: links that lead to other sites; they are listed and not followed.
    - `pages`: how many pages there are.
    """

    broken: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    outward: dict[str, str] = field(default_factory=dict)
    pages: int = 0


def check_links(site: Path) -> LinkReport:
    """Open every page of a built site."""
    site = site.resolve()
    read = {path: _read(path) for path in sorted(site.rglob("*.html")) if "playground" not in path.parts}
    report = LinkReport(pages=len(read))
    for path, page in read.items():
        name = path.relative_to(site).as_posix()
        for link in [*page.links, *page.fetched]:
            scheme = urlsplit(link).scheme
            if scheme in ("http", "https") or link.startswith("//"):
                if link in page.fetched:
                    report.foreign.append(f"{name}: {link}")
                else:
                    report.outward.setdefault(link, name)
            # The page of a missing page is served anywhere, so that its links begin at the root of the server.
            elif scheme not in ("data", "mailto", "javascript", "blob") and name != "404.html":
                fault = _wrong(link, path, site, read)
                report.broken += [f"{name}: {link} ({fault})"] if fault else []
    for style in site.rglob("*.css"):
        if STYLE.search(style.read_text(encoding="utf-8")):
            report.foreign.append(f"{style.relative_to(site)}: a font or a style of another host")
    return report


def _read(path: Path) -> _Page:
    page = _Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def _wrong(link: str, path: Path, site: Path, read: dict[Path, _Page]) -> str:
    target, anchor = urldefrag(link)
    target = unquote(urlsplit(target).path)
    to = path if not target else Path(os.path.normpath(path.parent / target))
    if to.is_dir():
        to = to / "index.html"
    if site not in to.parents or not (to in read or to.exists()):
        return "there is no such page"
    page = read.get(to)
    if anchor and page is not None and unquote(anchor) not in page.anchors and not anchor.startswith(":~:"):
        return "there is no such place on it"
    return ""


BUILD = ROOT / "build" / "site"
SITE = ROOT / "site"
BUILDER = Path(__file__).with_name("builder.py")


class Failed(Exception):
    """The site could not be made."""


def make(tools: Path, *, jobs: int = 2, run_code: bool = True, only: list[str] | None = None) -> None:
    """Make the site.

    - `jobs`: number of pages that run at a time.
    - `run_code`: True to run the code of the pages, and show its output.
    - `only`: run the code of these pages, and build nothing.

    Raises Failed, with all that is wrong.
    """
    started = time.perf_counter()
    BUILD.mkdir(parents=True, exist_ok=True)
    outcomes, failed = run_all(jobs, only) if run_code or only is not None else ({}, [])
    if failed:
        raise Failed("code on a page does not run:\n\n" + "\n\n".join(failed))
    if only is not None:
        return
    stage = Stage(BUILD / "docs")
    stage.lay_out()
    for place, result in outcomes.items():
        stage.pages[place] = with_results(stage.pages[place], place, result)
        stage.extra |= {f"{Path(place).parent}/made/{figure.name}": figure for figure in result.figures}
    with_gallery(stage, run_code)
    if run_code:
        with_playground(stage)
    _reference(stage)
    stage.write()
    _configure(stage)
    _build(tools)
    _check()
    _look(tools)
    print(f"{SITE / 'index.html'}: {time.perf_counter() - started:.0f} s")


def _reference(stage: Stage) -> None:
    """The pages that are made of declarations and docstrings, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _REFERENCE], cwd=ROOT / "scripts", capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise Failed(f"the reference cannot be made:\n{done.stderr[-3000:]}")
    pages, facts = json.loads(done.stdout)
    stage.pages |= pages
    (BUILD / "facts.json").write_text(json.dumps(facts, ensure_ascii=False), encoding="utf-8")


_REFERENCE = """
import json, sys
import jax
jax.config.update("jax_enable_x64", True)
from documentation.site import api_pages, parameters_page
pages, facts = api_pages()
pages["reference/parameters.md"] = parameters_page()
json.dump([pages, facts], sys.stdout)
"""


def _configure(stage: Stage) -> None:
    """Write the configuration with all pages in its table of contents."""
    from ruamel.yaml import YAML

    yaml = YAML()
    settings = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    listed = set(named(settings["nav"]))
    missing = sorted(listed - set(stage.pages))
    if missing:
        raise Failed(f"mkdocs.yml names pages that are not there: {', '.join(missing)}")
    reference = next(part for part in settings["nav"] if "Look up" in part)["Look up"]
    groups = [{group: [f"api/{room}.md" for room in members]} for group, members in GROUPS.items()]
    reference.append({"API": ["api/index.md", *groups]})
    rest = sorted(set(stage.pages) - listed - {name for name in stage.pages if name.startswith("api/")})
    if rest:
        print(f"pages that mkdocs.yml does not name, under More: {', '.join(rest)}")
        settings["nav"].append({"More": rest})
    settings["docs_dir"], settings["site_dir"] = "docs", "made"
    python = next(plugin["mkdocstrings"] for plugin in settings["plugins"] if "mkdocstrings" in plugin)["handlers"][
        "python"
    ]
    python["paths"] = [str(ROOT / "src")]
    python["options"]["extensions"] = [{f"{BUILDER}:Facts": {"path": str(BUILD / "facts.json")}}]
    with (BUILD / "mkdocs.yml").open("w", encoding="utf-8") as file:
        yaml.dump(settings, file)


def named(nav: list[object] | str) -> list[str]:
    """The pages of a table of contents, in order."""
    if isinstance(nav, str):
        return [nav]
    return [name for part in nav for name in (named(next(iter(part.values()))) if isinstance(part, dict) else [part])]


def _build(tools: Path) -> None:
    program = tools / "bin" / "zensical"
    if not program.exists():
        raise Failed(f"there is no {program}: `make docs` makes that environment")
    subprocess.run([tools / "bin" / "python", BUILDER, "formulas", BUILD / "docs"], check=True)
    shutil.rmtree(SITE, ignore_errors=True)
    done = subprocess.run(
        [program, "build", "--strict", "--clean", "--config-file", BUILD / "mkdocs.yml"],
        cwd=BUILD,
        env=os.environ | {"NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    printed = (done.stdout + done.stderr).strip()
    if done.returncode or "arning" in printed:
        raise Failed(f"the builder warns, or failed:\n{printed[-6000:]}")
    # The builder writes below its configuration only.
    shutil.move(BUILD / "made", SITE)


def _check() -> None:
    report = check_links(SITE)
    wrong = [
        *(f"leads nowhere: {link}" for link in report.broken),
        *(f"fetched from elsewhere: {link}" for link in report.foreign),
    ]
    if wrong:
        raise Failed(f"{len(wrong)} wrong links:\n" + "\n".join(wrong[:60]))
    listed = "\n".join(f"{link}  {page}" for link, page in sorted(report.outward.items()))
    (BUILD / "outward-links.txt").write_text(f"{listed}\n", encoding="utf-8")
    print(f"{report.pages} pages; {len(report.outward)} links to other sites, listed in {BUILD / 'outward-links.txt'}")


def _look(tools: Path) -> None:
    """Open every page in a browser, where there is one."""
    done = subprocess.run(
        [tools / "bin" / "python", BUILDER, "browser", SITE],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise Failed(f"pages are wrong in a browser:\n{done.stdout[-4000:]}")
    print(done.stdout.strip())
