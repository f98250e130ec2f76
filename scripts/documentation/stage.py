"""Lay out the pages of the site, with their results, the gallery and the playground."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from .commands import commands
from .pages import STORE, Block, PageResult, blocks, sources

ROOT = Path(__file__).parents[2]
ELSEWHERE = {
    "benchmarks/PERFORMANCE.md": "benchmarks.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Pages that lie outside of docs/, by where they are on the site."""

LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^()\s]+)(\s+\"[^\"]*\")?\)")
CODE = re.compile(r"(^ *```.*?^ *```|`[^`\n]*`|^    [^\n]*$)", re.DOTALL | re.MULTILINE)
SCHEME = re.compile(r"[a-z]+:")
POWER = re.compile(r"(?<![\w.-])\d+(?:\.\d+)?e-\d+\b")


@dataclass
class Stage:
    """The folder from which the site is built.

    - `folder`: where pages go.
    - `files`: what pages link to outside of docs/, by path in the repository.
    - `pages`: the pages that were laid out, by their place on the site.
    - `extra`: files that are generated for the site, by their place on it.
    """

    folder: Path
    files: set[str] = field(default_factory=set)
    pages: dict[str, str] = field(default_factory=dict)
    extra: dict[str, Path] = field(default_factory=dict)

    def lay_out(self) -> None:
        """Read all pages, with their links as the site needs them."""
        for path in sorted((ROOT / "docs").rglob("*.md")):
            place = path.relative_to(ROOT / "docs").as_posix()
            if not place.startswith("api/"):
                self.pages[place] = self.linked(path.read_text(encoding="utf-8"), f"docs/{place}", place)
        for source, place in ELSEWHERE.items():
            if (ROOT / source).exists():
                self.pages[place] = self.linked((ROOT / source).read_text(encoding="utf-8"), source, place)

    def linked(self, text: str, source: str, place: str) -> str:
        """A page whose links lead to pages and files of the site.

        - `place`: where it will be on the site.
        """
        start = os.path.dirname(place)

        def relink(match: re.Match[str]) -> str:
            label, target, title = match[1], match[2], match[3] or ""
            if SCHEME.match(target) or target.startswith("#"):
                return match[0]
            path, _, anchor = target.partition("#")
            inside = os.path.normpath(os.path.join(os.path.dirname(source), path))
            to = self.place_of(inside)
            joined = os.path.relpath(to, start or ".") + (f"#{anchor}" if anchor else "")
            # In the folder a page is known by its file, on the site by its title.
            if label == f"[{os.path.basename(path)}]" and path.endswith(".md"):
                label = f"[{_title(ROOT / inside)}]"
            return f"{label}({joined}{title})"

        parts = CODE.split(text)
        # GitHub needs a backslash before a bar in a table's code; the site would show it.
        return "".join(_unbarred(part) if k % 2 else _unbroken(LINK.sub(relink, part)) for k, part in enumerate(parts))

    def place_of(self, source: str) -> str:
        """Where a file of the repository is on the site."""
        if source in ELSEWHERE:
            return ELSEWHERE[source]
        if source == "README.md":
            return "index.md"
        if source.startswith("docs/"):
            return source.removeprefix("docs/")
        self.files.add(source)
        return f"files/{source}/index.md" if (ROOT / source).is_dir() else f"files/{source}.md"

    def write(self) -> None:
        """Write pages, figures and files down."""
        if self.folder.exists():
            shutil.rmtree(self.folder)
        for place, text in self.pages.items():
            path = self.folder / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        for path in sorted((ROOT / "docs").rglob("*")):
            if path.is_file() and path.suffix not in (".md",) and "api" not in path.parts:
                to = self.folder / path.relative_to(ROOT / "docs")
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(path, to)
        for source in sorted(self.files):
            self._file(source)
        for place, path in self.extra.items():
            to = self.folder / place
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, to)

    def _file(self, source: str) -> None:
        """A page that shows a file, or lists a folder."""
        path = ROOT / source
        if not path.exists():
            raise FileNotFoundError(f"a page links to `{source}`, which is not there")
        target = self.folder / self.place_of(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            inside = sorted(inner for inner in path.rglob("*") if inner.is_file() and "__pycache__" not in inner.parts)
            lines = [f"# `{source}`", ""]
            for inner in inside:
                relative = inner.relative_to(path).as_posix()
                lines.append(f"- [{relative}]({relative}.md)")
                self._shown(inner, self.folder / "files" / f"{source}/{relative}.md")
            target.write_text("\n".join([*lines, ""]), encoding="utf-8")
        else:
            self._shown(path, target)

    def _shown(self, path: Path, target: Path) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        raw = target.with_suffix("")
        shutil.copy(path, raw)
        if path.suffix == ".md":
            shown = self.linked(text, name, target.relative_to(self.folder).as_posix())
            target.write_text(shown, encoding="utf-8")
            return
        language = {".py": "python", ".yaml": "yaml", ".urdf": "xml", ".xml": "xml"}.get(path.suffix, "text")
        body = f"# `{html.escape(name)}`\n\n[The file itself]({raw.name})\n\n````{language}\n{text}\n````\n"
        target.write_text(body, encoding="utf-8")


def _unbarred(code: str) -> str:
    return code if code.lstrip().startswith("```") or code.startswith("    ") else code.replace("\\|", "|")


def _unbroken(text: str) -> str:
    """Numbers such as 1.2e-04 in one line: a browser would break them after the hyphen."""
    return POWER.sub(r'<span class="number">\g<0></span>', text)


def _title(page: Path) -> str:
    """The title of a page, up to a colon."""
    first = page.read_text(encoding="utf-8").lstrip().partition("\n")[0].removeprefix("# ")
    return first.partition(":")[0].strip()


SHOWN = ("tutorials/", "getting-started.md", "design.md", "studies.md", "identification.md", "loop.md")
"""The pages that show what their code prints; on the others it is run only."""

LONGEST = 40
"""Lines of output that are shown; the rest can be unfolded."""


def with_results(text: str, place: str, result: PageResult) -> str:
    """The page with its results.

    - `text`: of the page, as it is laid out.
    """
    lines, every = text.split("\n"), blocks(text)
    for block, following, outcome in reversed(list(zip(every, [*every[1:], None], result.outcomes, strict=True))):
        below: list[str] = []
        # Where the page has the output itself, it is not shown twice.
        if place.startswith(SHOWN) and not (following and "said" in following.marks):
            for text_shown in _texts(block, outcome["texts"]):
                below += ["", *_folded(text_shown)]
            if outcome["skipped"] and "not run" not in block.marks:
                below += ["", f"*Not run here: {outcome['skipped']}.*"]
        title = block.text.strip().strip('"') if block.language == "show" else ""
        for figure in outcome["figures"]:
            below += ["", f"![{title or 'Figure of the code above'}](made/{figure})"]
        lines[block.last + 1 : block.last + 1] = below
    return "\n".join(lines)


def _texts(block: Block, texts: list[str]) -> list[str]:
    """The output of a block, with each command before its own if there are several."""
    lines = (
        [command.line for command in commands(block.language, block.text)]
        if block.language in ("console", "sh")
        else []
    )
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


GALLERY_MARK = "<!-- gallery -->"
GALLERY_PAGE = "browser.md"

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
from slidax.report.figures.style import save
out = Path(sys.argv[1])
rows = []
for name in sys.argv[2:]:
    scenario = sx.scenarios.load(name)
    run = scenario.simulate()
    save(sx.figures.tracking_error(run), out / f"{name}-error.svg")
    save(sx.figures.torque(run), out / f"{name}-torque.svg")
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
    """Fill the page of the gallery, where it has its mark."""
    if GALLERY_PAGE not in stage.pages or not run_code:
        return
    folder = _gallery_folder()
    from slidax.scenarios import catalogue

    titles = catalogue()["scenarios"]
    rows = json.loads((folder / "gallery.json").read_text(encoding="utf-8"))
    sections = [_section(row["name"], titles[row["name"]], row["numbers"]) for row in rows]
    stage.pages[GALLERY_PAGE] = stage.pages[GALLERY_PAGE].replace(GALLERY_MARK, "\n".join(sections))
    stage.extra |= {f"made/{path.name}": path for path in folder.glob("*.svg")}


def _gallery_folder() -> Path:
    folder = STORE / f"gallery-{sources()[:16]}"
    if not (folder / "gallery.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        from slidax.scenarios import catalogue

        names = list(catalogue()["scenarios"])
        subprocess.run([sys.executable, "-c", PROGRAM, folder, *names], check=True)
    return folder


def _section(name: str, title: str, numbers: dict[str, str]) -> str:
    numbers_listed = "; ".join(f"{key}: {value}" for key, value in numbers.items())
    return "\n".join(
        [
            f"### {html.escape(title)}",
            "",
            f"`slidax run {name}`: {numbers_listed}.",
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


PLAYGROUND_MARK = "<!-- playground -->"
PLAYGROUND_PAGE = "browser.md"
THERE = """<iframe class="playground" src="playground/index.html" title="The playground" loading="lazy"></iframe>

[The playground on a page of its own](playground/index.html)"""
MISSING = "This copy of the site was built without the playground."


def with_playground(stage: Stage) -> None:
    """Make the playground if slidax can, and put it on its page."""
    folder = STORE / f"playground-{sources()[:16]}"
    if not (folder / "index.html").exists():
        done = subprocess.run(
            [sys.executable, "-c", "from slidax.cli import main; main()", "export", "web", "--out", folder],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["`slidax export web` is missing"])[-1]
            print(f"no playground on this site: {last.strip('│ ')}")
    there = (folder / "index.html").exists()
    if PLAYGROUND_PAGE in stage.pages:
        stage.pages[PLAYGROUND_PAGE] = stage.pages[PLAYGROUND_PAGE].replace(
            PLAYGROUND_MARK, THERE if there else MISSING
        )
    if there:
        stage.extra["playground/index.html"] = folder / "index.html"
