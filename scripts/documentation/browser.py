"""Opens every page of the site in a browser: nothing is fetched from elsewhere, nothing fails, nothing is too wide.

It runs in the environment of the site's builder: `python browser.py SITE`. Without a browser it says so.
"""

from __future__ import annotations

import functools
import re
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

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
        """Says nothing."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that goes on to the next page has hung up, and nothing is wrong."""


@contextmanager
def served(site: Path) -> Iterator[str]:
    """The address of the site, served to this machine alone.

    - `site`: its folder.
    """
    with _Server(("127.0.0.1", 0), functools.partial(_Quiet, directory=site)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


def looked_at(site: Path, program: str) -> list[str]:
    """What is wrong with the pages, on a phone in dark colours; some also on a desk in light ones.

    - `site`: its folder.
    - `program`: of the browser.
    """
    from playwright.sync_api import Error as PlaywrightError
    from playwright.sync_api import sync_playwright

    names = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html") if "playground" not in path.parts)
    wrong: list[str] = []
    with served(site) as base, sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=program, args=OPTIONS)
        for size, colours, pages in ((PHONE, "dark", names), (DESK, "light", names[::10])):
            page = browser.new_context(viewport=size, color_scheme=colours).new_page()
            page.on("request", lambda one: wrong.append(f"fetches {one.url}") if _foreign(one.url, base) else None)
            page.on("pageerror", lambda error: wrong.append(f"fails: {error}"))
            for name in pages:
                before = len(wrong)
                page.goto(base + name)
                if (width := page.evaluate("document.documentElement.scrollWidth")) > size["width"]:
                    wrong.append(f"is {width} wide on {size['width']}")
                wrong[before:] = [f"{name}: {one}" for one in wrong[before:]]
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


def main() -> None:
    """Looks at all pages."""
    program = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if program is None:
        print("no browser here: pages were not looked at")
        return
    wrong = looked_at(Path(sys.argv[1]).resolve(), program)
    if wrong:
        raise SystemExit("\n".join(wrong))
    print("in a browser: every page is whole, none fetches anything from elsewhere, the search finds what it should")


if __name__ == "__main__":
    main()
