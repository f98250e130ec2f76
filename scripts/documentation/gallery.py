"""The gallery: every built-in scenario, run when the site is built, with its pictures and its numbers."""

from __future__ import annotations

import html
import json
import subprocess
import sys
from pathlib import Path

from .cache import STORE, sources
from .stage import Stage

MARK = "<!-- gallery -->"
PAGE = "gallery.md"

PROGRAM = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import json
import matplotlib as mpl
mpl.use("agg")
mpl.rcParams["svg.hashsalt"] = "gallery"
import slidax as sx
from pathlib import Path
out = Path(sys.argv[1])
rows = []
for name in sys.argv[2:]:
    scenario = sx.scenarios.load(name)
    run = scenario.simulate()
    sx.figures.tracking_error(run).savefig(out / f"{name}-error.svg")
    sx.figures.torque(run).savefig(out / f"{name}-torque.svg")
    numbers = {"outcome": run.outcome.message if not run.outcome.ok else "ok"}
    if run.outcome.ok:
        numbers["steady error, worst joint"] = f"{max(map(float, sx.metrics.steady_error(run))):.2g} rad or m"
        step = max(map(float, sx.metrics.steady_torque_step(run)))
        numbers["torque step, steady, worst joint"] = f"{step:.2g} N m or N"
        margin = sx.metrics.envelope_margin(run)
        if margin is not None:
            numbers["least room in the envelope"] = f"{100 * min(map(float, margin)):.0f} % of its width"
    rows.append({"name": name, "numbers": numbers})
(out / "gallery.json").write_text(json.dumps(rows), encoding="utf-8")
"""


def with_gallery(stage: Stage, run_code: bool) -> None:
    """Fills the page of the gallery, where it has its mark.

    - `stage`: with the page.
    - `run_code`: whether the scenarios are run.
    """
    if PAGE not in stage.pages or not run_code:
        return
    folder = _made()
    from slidax.scenarios import catalogue

    titles = catalogue()["scenarios"]
    rows = json.loads((folder / "gallery.json").read_text(encoding="utf-8"))
    sections = [_section(row["name"], titles[row["name"]], row["numbers"]) for row in rows]
    stage.pages[PAGE] = stage.pages[PAGE].replace(MARK, "\n".join(sections))
    stage.made |= {f"made/{path.name}": path for path in folder.glob("*.svg")}


def _made() -> Path:
    folder = STORE / f"gallery-{sources()[:16]}"
    if not (folder / "gallery.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        from slidax.scenarios import catalogue

        names = list(catalogue()["scenarios"])
        subprocess.run([sys.executable, "-c", PROGRAM, folder, *names], check=True)
    return folder


def _section(name: str, title: str, numbers: dict[str, str]) -> str:
    said = "; ".join(f"{key}: {value}" for key, value in numbers.items())
    return "\n".join(
        [
            f"## {html.escape(title)}",
            "",
            f"`slidax run {name}`: {said}.",
            "",
            '<div class="gallery" markdown>',
            "",
            f"![Errors of {name} in their envelope](made/{name}-error.svg)",
            "",
            f"![Torques of {name}](made/{name}-torque.svg)",
            "",
            "</div>",
            "",
        ]
    )
