"""Puts what the code of a page has printed and drawn below it."""

from __future__ import annotations

import html

from .blocks import Block, blocks
from .cache import Found
from .commands import commands

SHOWN = ("tutorials/", "getting-started.md")
"""The pages that show what their code prints; on the others it is run only."""

LONGEST = 40
"""Lines of output that are shown; the rest can be unfolded."""


def with_results(text: str, place: str, found: Found) -> str:
    """The page with its results.

    - `text`: of the page, as it is laid out.
    - `place`: on the site.
    - `found`: what its code has made.
    """
    lines = text.split("\n")
    for block, outcome in reversed(list(zip(blocks(text), found.outcomes, strict=True))):
        below: list[str] = []
        if place.startswith(SHOWN):
            for one in _texts(block, outcome["texts"]):
                below += ["", *_folded(one)]
            if outcome["skipped"] and "not run" not in block.marks:
                below += ["", f"*Not run here: {outcome['skipped']}.*"]
        title = block.text.strip().strip('"') if block.language == "show" else ""
        for figure in outcome["figures"]:
            below += ["", f"![{title or 'What the code above draws'}](made/{figure})"]
        lines[block.last + 1 : block.last + 1] = below
    return "\n".join(lines)


def _texts(block: Block, texts: list[str]) -> list[str]:
    """What was printed, with the command before it where a block has several."""
    lines = [one.line for one in commands(block.language, block.text)] if block.language in ("console", "sh") else []
    if len(lines) > 1 and len(texts) == len(lines):
        shown = [
            f"$ {line.split('  #')[0].rstrip()}\n{text}"
            for line, text in zip(lines, texts, strict=True)
            if text.strip()
        ]
    else:
        shown = texts
    return [text.rstrip() for text in shown if text.strip()]


def _folded(text: str) -> list[str]:
    rows = [row.rstrip() for row in text.split("\n")]
    if len(rows) <= LONGEST:
        return [_pre(rows)]
    head, rest = rows[: LONGEST // 2], rows[LONGEST // 2 :]
    return [_pre(head), "", f"<details><summary>{len(rest)} more lines</summary>", _pre(rest), "</details>"]


def _pre(rows: list[str]) -> str:
    # An empty line would end the block of HTML for the reader of Markdown.
    body = "\n".join(html.escape(row) if row else "&#8203;" for row in rows)
    return f'<div class="output"><pre><code>{body}</code></pre></div>'
