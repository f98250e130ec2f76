"""The playground beside the site: the closed loop as WebAssembly, on a page of its own."""

from __future__ import annotations

import subprocess
import sys

from .cache import STORE, sources
from .stage import ROOT, Stage

MARK = "<!-- playground -->"
PAGE = "playground.md"
THERE = """<iframe class="playground" src="playground/index.html" title="The playground" loading="lazy"></iframe>

[The playground on a page of its own](playground/index.html)"""
MISSING = "This copy of the site was built without the playground."


def with_playground(stage: Stage) -> None:
    """Makes the playground if slidax can, and puts it on its page.

    - `stage`: with the page.
    """
    made = STORE / f"playground-{sources()[:16]}"
    if not (made / "index.html").exists():
        done = subprocess.run(
            [sys.executable, "-c", "from slidax.cli import main; main()", "export", "web", "--out", made],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["`slidax export web` is missing"])[-1]
            print(f"no playground on this site: {last.strip('│ ')}")
    there = (made / "index.html").exists()
    if PAGE in stage.pages:
        stage.pages[PAGE] = stage.pages[PAGE].replace(MARK, THERE if there else MISSING)
    if there:
        stage.made["playground/index.html"] = made / "index.html"
