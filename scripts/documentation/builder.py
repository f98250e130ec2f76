"""Tools that run in the environment of the site's builder, which has no JAX: formulas, facts, and a browser.

    builder.py formulas FOLDER    draw the formulas of all pages as MathML, without script, fonts or network
    builder.py browser SITE       open every page in a browser, if there is one, and report problems

mkdocs loads `Facts`, which completes the docstrings from the sources.
"""

from __future__ import annotations

import functools
import json
import re
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from griffe import Docstring, Extension, Object
from latex2mathml.converter import convert


class Facts(Extension):
    """An extension of griffe.

    - `path`: the file of facts, by full names.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self.facts: dict[str, str] = json.loads(Path(path).read_text(encoding="utf-8"))

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Complete the docstring of a class, a function or a named value."""
        fact = self.facts.get(obj.path)
        if fact is None:
            return
        if obj.docstring is None:
            obj.docstring = Docstring(fact, parent=obj)
        elif fact not in obj.docstring.value:
            obj.docstring.value = f"{obj.docstring.value}\n\n{fact}"


BLOCK = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TAG = re.compile(r"\\tag\{([^}]*)\}")
INLINE = re.compile(r"\$`([^`\n]+)`\$")


def with_mathml(text: str) -> str:
    """A page with its formulas drawn: blocks of the language `math`, and what stands between $` and `$."""

    def block(match: re.Match[str]) -> str:
        number = TAG.search(match[1])
        drawn = convert(TAG.sub("", match[1]).strip(), display="block")
        name = f"Formula ({number[1]})" if number else "Formula"
        shown = f"<span>({number[1]})</span>" if number else ""
        # A wide one scrolls, and so has to be reached by keys.
        return f'<div class="formula" tabindex="0" role="group" aria-label="{name}">{drawn}{shown}</div>'

    # In a span, since a line that begins with <math> would end the paragraph.
    return INLINE.sub(lambda match: f"<span>{convert(match[1])}</span>", BLOCK.sub(block, text))


def draw_formulas(folder: Path) -> None:
    """Draw the formulas of all pages of a folder."""
    for path in sorted(folder.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if BLOCK.search(text) or INLINE.search(text):
            path.write_text(with_mathml(text), encoding="utf-8")


BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
WORD = "envelope"


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that goes on to the next page has hung up, and nothing is wrong."""


@contextmanager
def served(site: Path) -> Iterator[str]:
    """The address of the site, served to this machine alone."""
    with _Server(("127.0.0.1", 0), functools.partial(_Quiet, directory=site)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


def problems(site: Path, program: str) -> list[str]:
    """Problems of the pages, on a phone in dark colours, some on a desk: foreign files, failed scripts, too wide."""
    from playwright.sync_api import Error as PlaywrightError
    from playwright.sync_api import sync_playwright

    names = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html") if "playground" not in path.parts)
    wrong: list[str] = []
    with served(site) as base, sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=program, args=OPTIONS)
        for size, colours, pages in ((PHONE, "dark", names), (DESK, "light", names[::10])):
            page = browser.new_context(viewport=size, color_scheme=colours).new_page()
            page.on(
                "request", lambda entry: wrong.append(f"fetches {entry.url}") if _foreign(entry.url, base) else None
            )
            page.on("pageerror", lambda error: wrong.append(f"fails: {error}"))
            for name in pages:
                before = len(wrong)
                page.goto(base + name)
                if (width := page.evaluate("document.documentElement.scrollWidth")) > size["width"]:
                    wrong.append(f"is {width} wide on {size['width']}")
                wrong[before:] = [f"{name}: {entry}" for entry in wrong[before:]]
        page.goto(f"{base}index.html")
        page.wait_for_load_state("networkidle")
        page.keyboard.press("Control+k")
        page.keyboard.type(WORD, delay=30)
        try:
            page.get_by_text(re.compile(r"\d\d+ results")).wait_for(timeout=30_000)
        except PlaywrightError as error:
            wrong.append(f"the search for `{WORD}` finds nothing: {error}")
        browser.close()
    return wrong


def _foreign(url: str, base: str) -> bool:
    return not url.startswith((base, "data:", "blob:"))


def look_at_site(site: Path) -> None:
    """Open all pages."""
    program = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if program is None:
        print("no browser here: pages were not looked at")
        return
    wrong = problems(site.resolve(), program)
    if wrong:
        raise SystemExit("\n".join(wrong))
    print("in a browser: every page is whole, none fetches anything from elsewhere, the search finds what it should")


if __name__ == "__main__":
    {"formulas": draw_formulas, "browser": look_at_site}[sys.argv[1]](Path(sys.argv[2]))
