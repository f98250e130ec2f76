"""The playground's page as one file: style, scripts and data in one HTML text without external requests."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

PAGE = resources.files(str(__package__)) / "page"

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
    "worker-src blob:; img-src data: blob:; connect-src 'none'; form-action 'none'; base-uri 'none'"
)
"""Content security policy: no network access."""

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([a-z_]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?function|class|const|let)", re.MULTILINE)


def page_text(
    manifest: Mapping[str, Any],
    *,
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
    loop: str | None = None,
    policy: str | None = POLICY,
) -> str:
    """Return one HTML file that shows a playground.

    - `manifest`: arms, programs, settings; binary data as base64 of gzip.
    - `scripts`, `styles`: additions, before the page's own script and after its own style.
    - `loop`: the module that runs a program; by default the page's own.
    - `policy`: the content security policy in the page; None leaves it to a server's header.
    """
    replaced = {} if loop is None else {"loop.js": loop}
    title = str(manifest.get("title", "slidax"))
    parts = {
        "title": _escaped(title),
        "policy": "" if policy is None else f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        "style": "\n".join([_source("style.css"), *styles]),
        "playground": json.dumps(manifest, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace(
            "<", "\\u003c"
        ),
        "worker": module_text("worker.js", replaced),
        "scripts": "\n".join(f"<script>\n{script}\n</script>" for script in scripts),
        "main": module_text("main.js", replaced),
    }
    return re.sub(r"\{\{ (\w+) \}\}", lambda match: parts[match[1]], _source("index.html"))


def module_text(entry: str, replaced: Mapping[str, str] | None = None) -> str:
    """Bundle a module and all its imports as the text of one module.

    - `replaced`: texts that replace files of these names.

    Raises ValueError if modules import each other in a circle.
    """
    done: dict[str, str] = {}
    _gather(entry, replaced or {}, done, ())
    return "\n".join(done.values())


def _gather(name: str, replaced: Mapping[str, str], done: dict[str, str], above: tuple[str, ...]) -> None:
    if name in done:
        return
    if name in above:
        raise ValueError("modules import each other: " + " -> ".join([*above, name]))
    text = replaced[name] if name in replaced else _source(name)
    for match in _IMPORT.finditer(text):
        _gather(match[2], replaced, done, (*above, name))
    done[name] = _EXPORT.sub("", _IMPORT.sub("", text)).strip() + "\n"


def _source(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
