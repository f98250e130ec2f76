"""The playground's page as one file: style, scripts and data in one HTML text that asks for nothing else."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

PAGE = resources.files("slidax.deploy.web") / "page"

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
    "worker-src blob:; img-src data: blob:; connect-src 'none'; form-action 'none'; base-uri 'none'"
)
"""What the browser lets the page do: nothing that asks a network."""

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
    """One HTML file that shows a playground.

    - `manifest`: the playground: arms, programs, settings; numbers, texts, and what is binary as base64 of gzip.
    - `scripts`, `styles`: more of both, put before the page's own script and after its own style.
    - `loop`: the module that runs a program, if it is another than the page's own.
    - `policy`: the content security policy in the page; None leaves it to a server's header.
    """
    given = {} if loop is None else {"loop.js": loop}
    title = str(manifest.get("title", "slidax"))
    parts = {
        "title": _escaped(title),
        "policy": "" if policy is None else f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        "style": "\n".join([_source("style.css"), *styles]),
        "playground": json.dumps(manifest, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace(
            "<", "\\u003c"
        ),
        "worker": module_text("worker.js", given),
        "scripts": "\n".join(f"<script>\n{script}\n</script>" for script in scripts),
        "main": module_text("main.js", given),
    }
    return re.sub(r"\{\{ (\w+) \}\}", lambda found: parts[found[1]], _source("index.html"))


def module_text(entry: str, given: Mapping[str, str] | None = None) -> str:
    """A module with all that it imports, as the text of one module.

    - `entry`: its file name in the page's folder.
    - `given`: texts that stand for files of these names.

    Raises ValueError if modules import each other in a circle.
    """
    done: dict[str, str] = {}
    _gather(entry, given or {}, done, ())
    return "\n".join(done.values())


def _gather(name: str, given: Mapping[str, str], done: dict[str, str], above: tuple[str, ...]) -> None:
    if name in done:
        return
    if name in above:
        raise ValueError("modules import each other: " + " -> ".join([*above, name]))
    text = given[name] if name in given else _source(name)
    for found in _IMPORT.finditer(text):
        _gather(found[2], given, done, (*above, name))
    done[name] = _EXPORT.sub("", _IMPORT.sub("", text)).strip() + "\n"


def _source(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
