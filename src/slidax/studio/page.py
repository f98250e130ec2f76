"""The studio's page: the playground's page with the studio's panels."""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping
from html.parser import HTMLParser
from importlib import resources
from typing import Any

from slidax.deploy.web.page_text import PAGE, page_text

FOLDER = resources.files("slidax.studio") / "page"

SCRIPTS = ("api.js", "scenario.js", "job-card.js", "jobs.js", "files.js", "studio.js")
"""In this order: each uses the previous ones."""

POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; connect-src 'self'; "
    "worker-src blob:; img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def page(manifest: Mapping[str, Any]) -> tuple[str, str]:
    """The page for a `manifest`, and its security policy: only our scripts, and requests only to the studio."""
    nonce = secrets.token_urlsafe(18)
    text = page_text(
        manifest,
        scripts=[_source(name) for name in SCRIPTS],
        styles=[_source("studio.css")],
        policy=None,
        loop=None if _has_loop() else "export async function openProgram() { throw new Error('none'); }",
    )
    return _with_nonce(text, nonce), POLICY.format(nonce=nonce)


def _has_loop() -> bool:
    return (PAGE / "loop.js").is_file()


def _source(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


class _Scripts(HTMLParser):
    """Finds the positions of script elements; text within scripts does not count."""

    def __init__(self) -> None:
        super().__init__()
        self.places: list[tuple[int, int]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.places.append(self.getpos())


def _with_nonce(text: str, nonce: str) -> str:
    scripts = _Scripts()
    scripts.feed(text)
    lines = text.split("\n")
    for line, column in reversed(scripts.places):
        whole = lines[line - 1]
        lines[line - 1] = whole[:column] + re.sub("^<script", f'<script nonce="{nonce}"', whole[column:])
    return "\n".join(lines)
