"""A browser without a window, for tests of pages; skipped, with a reason, where there is none."""

from __future__ import annotations

import http.server
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE = 30_000
"""How long anything may take on a busy machine [ms]."""

SETTLED = "window.slidaxPage?.ready === true && slidaxPage.session.settled"


@contextmanager
def browser() -> Iterator[Any]:
    """Chromium by Playwright."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("there is no Chromium on this machine")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=found, args=ARGUMENTS)
        try:
            yield chromium
        finally:
            chromium.close()


class Visit:
    """A page that is open, and all that it asked, said and got wrong."""

    def __init__(self, chromium: Any, address: str, **given: Any) -> None:
        given = {"viewport": {"width": 1280, "height": 800}, "accept_downloads": True, **given}
        self.context = chromium.new_context(**given)
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda said: said.type == "error" and self.errors.append(said.text))
        self.page.goto(address)
        self.settle()

    def settle(self) -> None:
        """Waits until what is shown is of what is chosen. The page forbids `eval`, by which Playwright would wait."""
        for _ in range(PATIENCE // 20):
            if self.page.evaluate(SETTLED):
                return
            self.page.wait_for_timeout(20)
        raise AssertionError("the page did not settle: " + (self.page.text_content("#fault") or "no reason was shown"))

    def state(self) -> Any:
        return self.page.evaluate("slidaxPage.state()")

    def text(self, place: str) -> str:
        return self.page.inner_text(place)

    def saved(self, button: str) -> Any:
        with self.page.expect_download() as got:
            self.page.click(button)
        return got.value

    def close(self) -> None:
        self.context.close()


def typed(visit: Visit, tunable: str, value: str) -> None:
    """Types a number into a tunable's box."""
    visit.page.evaluate("document.querySelectorAll('#tunables .group').forEach(one => { one.open = true; })")
    box = visit.page.locator(f"{tunable} > .slider .box")
    box.fill(value)
    box.press("Enter")
    visit.settle()


@contextmanager
def served(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """A folder behind a plain file server on loopback: its address, and every path that was asked for."""
    asked: list[str] = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *said: Any) -> None:
            asked.append(self.path)

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", asked
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
