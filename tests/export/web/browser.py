"""A browser without a window, for tests of pages; skipped, with a reason, where there is none."""

import http.server
import shutil
import threading
from contextlib import contextmanager
from functools import partial

import pytest

ARGUMENTS = [
    *("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
PATIENCE = 30_000
"""Time limit of any action on a busy machine [ms]."""

SETTLED = "window.slidaxPage?.ready === true && slidaxPage.session.settled"


@contextmanager
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    result = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if result is None:
        pytest.skip("there is no Chromium on this machine")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=result, args=ARGUMENTS)
        try:
            yield chromium
        finally:
            chromium.close()


class Visit:
    def __init__(self, chromium, address, **options):
        options = {"viewport": {"width": 1280, "height": 800}, "accept_downloads": True, **options}
        self.context = chromium.new_context(**options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.requests = []
        self.errors = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: message.type == "error" and self.errors.append(message.text))
        self.page.goto(address)
        self.settle()

    def settle(self):
        for _ in range(PATIENCE // 20):
            if self.page.evaluate(SETTLED):
                return
            self.page.wait_for_timeout(20)
        raise AssertionError("the page did not settle: " + (self.page.text_content("#fault") or "no reason was shown"))

    def state(self):
        return self.page.evaluate("slidaxPage.state()")

    def text(self, place):
        return self.page.inner_text(place)

    def saved(self, button):
        with self.page.expect_download() as got:
            self.page.click(button)
        return got.value

    def close(self):
        self.context.close()


def typed(visit, tunable, value):
    visit.page.evaluate("document.querySelectorAll('#tunables .group').forEach(one => { one.open = true; })")
    box = visit.page.locator(f"{tunable} > .slider .box")
    box.fill(value)
    box.press("Enter")
    visit.settle()


@contextmanager
def served(folder):
    paths = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *message):
            paths.append(self.path)

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", paths
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
