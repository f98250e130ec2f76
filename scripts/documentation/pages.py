"""Read the code of pages: blocks, marks and commands; and run it as a reader would.

An unchanged page is not run again.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import dataclasses
import hashlib
import importlib.util
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from typing import Any

from .commands import PageError, commands

FENCE = re.compile(r"^( *)(`{3,}|~{3,})(\w*)[^\n`]*$")
MARK = re.compile(r"<!--\s*(.*?)\s*-->", re.DOTALL)
NAMED = re.compile(r"(not run|with|exit|file|part of|needs|shell|small|said):\s*(.*)", re.DOTALL)
HIDDEN = re.compile(r"before\n(.*)", re.DOTALL)
SHOW = re.compile(r"show:\s*(\S+)\s+(.*)", re.DOTALL)

MARKS = {
    "not run": "why this block is not run; its commands are parsed all the same",
    "with": "options that each command gets when it is run, so that it is short",
    "exit": "the exit code of the block's last command, 0 if not given",
    "file": "`NAME = SOURCE`: a file of this repository that stands in for the reader's own",
    "part of": "the scenario whose part a YAML block is",
    "needs": "packages or programs without which the block is not run",
    "shell": "the block is run by bash as a whole, where these programs are there",
    "said": "by what: the block is what the Python block before it prints",
    "small": "why the block belongs to the tests of every day",
}
"""Marks in a comment before a block, `<!-- mark: value -->`."""


@dataclass(frozen=True)
class Block:
    """A block of code.

    - `language`: as the page names it; `before` for code that readers do not see, `show` for a figure.
    - `text`: what is in it.
    - `first`, `last`: its lines on the page, from 0, marks and fences included.
    - `marks`: as in `MARKS`.
    """

    language: str
    text: str
    first: int
    last: int
    marks: dict[str, str] = field(default_factory=dict)


def blocks(text: str) -> list[Block]:
    """All blocks of a page, in order.

    Raises PageError for an open fence, or a mark that nothing follows.
    """
    return list(_blocks(text.split("\n")))


def _blocks(lines: list[str]) -> Iterator[Block]:
    marks: dict[str, str] = {}
    marked = 0
    row = 0
    while row < len(lines):
        line = lines[row]
        # In a list a block and its marks stand further in.
        if line.lstrip().startswith("<!--"):
            end = row
            while "-->" not in lines[end]:
                end += 1
            comment = MARK.fullmatch("\n".join(lines[row : end + 1]).strip())
            comment_text = comment[1] if comment else ""
            if hidden := HIDDEN.fullmatch(comment_text):
                yield Block("before", hidden[1], row, end)
            elif shown := SHOW.fullmatch(comment_text):
                yield Block("show", shown[2], row, end, {"file": shown[1]})
            elif named := NAMED.fullmatch(comment_text):
                marked = marked if marks else row
                marks[named[1]] = f"{marks[named[1]]}\n{named[2]}" if named[1] in marks else named[2]
            row = end + 1
            continue
        fence = FENCE.match(line)
        if fence:
            start, closing = row, re.compile(rf"^ *{fence[2]}\s*$")
            row += 1
            while row < len(lines) and not closing.match(lines[row]):
                row += 1
            if row == len(lines):
                raise PageError(f"line {start + 1}: this block has no end")
            body = "".join(f"{inner.removeprefix(fence[1])}\n" for inner in lines[start + 1 : row])
            yield Block(fence[3], body, marked if marks else start, row, marks)
            marks = {}
        elif line.strip() and marks:
            raise PageError(f"line {marked + 1}: a mark, {next(iter(marks))!r}, with no block after it")
        row += 1
    if marks:
        raise PageError(f"line {marked + 1}: a mark, {next(iter(marks))!r}, with no block after it")


PATHS = ("truth", "uncertainty")
"""Blocks of a scenario whose keys are paths themselves."""


def check_yaml(text: str, part_of: str, folder: Path) -> None:
    """Read a block as slidax reads such a file; a block whose first line is `# NAME.yaml` is written down as well.

    - `part_of`: the built-in scenario whose part it is; `unread` if only its YAML is read; empty for a whole file.

    Raises PageError if it is not whole and no scenario is named, DefinitionError if slidax refuses it.
    """
    from slidax.scenarios import parse
    from slidax.scenarios.yaml_text import read_yaml

    if name := re.match(r"# (\S+\.ya?ml)\n", text):
        (folder / name[1]).write_text(text, encoding="utf-8")
    read: Any = read_yaml(text)
    if part_of == "unread":
        return
    if part_of:
        whole = files("slidax.scenarios.built_in").joinpath(f"{part_of}.yaml").read_text(encoding="utf-8")
        parse(whole, dotted(read))
    elif not isinstance(read, dict):
        raise PageError("a YAML block must be a mapping")
    elif {"robot", "scheme", "trajectory"} <= set(read):
        parse(text)
    elif "study" in read:
        from slidax.studies import read_study

        (folder / "a-study-on-the-page.yaml").write_text(text, encoding="utf-8")
        read_study(folder / "a-study-on-the-page.yaml", {})
    elif not ("requirements" in read and "robot" in read):
        raise PageError("this YAML is no whole file: say of which scenario it is a part, `<!-- part of: NAME -->`")


def dotted(read: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """The numbers of a mapping by their paths, so that what stands beside them in the scenario remains.

    - `read`: a mapping of mappings; one that has a `kind` is given whole.
    """
    leaves: dict[str, Any] = {}
    for key, value in read.items():
        path = f"{prefix}{key}"
        whole = not isinstance(value, dict) or "kind" in value or key in PATHS
        leaves |= {path: value} if whole else dotted(value, f"{path}.")
    return leaves


ROOT = Path(__file__).parents[2]
START = ROOT / "docs" / "getting-started.md"
INSTALL = re.compile(r"pip install '(?:slidax|\.)\[([\w,]+)\]'")
COLUMNS = 95
LONGEST_LINE = 1000
"""Longest line that a block may print [characters]."""


def modules_of_other_extras(text: str) -> set[str]:
    """Modules of the extras that no install command in the text of a page names."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    named = {extra for line in INSTALL.findall(text) for extra in line.split(",")}
    if "all" in named:
        return set()
    kept = {_package(need) for extra in named for need in extras[extra]}
    others = {_package(need) for extra, needs in extras.items() if extra != "all" for need in needs} - kept
    packages = metadata.packages_distributions()
    return {module for module, names in packages.items() if {*map(_package, names)} & others}


def _package(requirement: str) -> str:
    return re.split(r"[>=<\[; ]", requirement)[0].lower().replace("_", "-")


@dataclass
class Outcome:
    """Result of a block.

    - `index`: of the block on the page.
    - `texts`: the output, after each of its commands, or once for Python.
    - `figures`: files, in the folder of the outputs.
    - `skipped`: the reason if it was not run, else empty.
    """

    index: int
    texts: list[str] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)
    skipped: str = ""
    seconds: float = 0.0


class PageRun:
    """Run the blocks of a page in a folder of its own, with one namespace for all Python.

    - `page`: its file.
    - `folder`: where a reader stands; `examples` is copied there.
    - `out`: where figures are put.
    - `small`: whether only blocks marked as small are run.
    """

    def __init__(self, page: Path, folder: Path, out: Path, small: bool = False) -> None:
        self.page, self.folder, self.out, self.small = page, folder, out, small
        self.names: dict[str, Any] = {"__name__": "__main__"}
        self.printed = ""
        shutil.copytree(ROOT / "examples", folder / "examples", dirs_exist_ok=True)
        out.mkdir(parents=True, exist_ok=True)

    def run(self) -> list[Outcome]:
        """All blocks, one after the other.

        Raises PageError, with the line of the page, for the first that does not run.
        """
        outcomes = []
        for index, block in enumerate(blocks(self.page.read_text(encoding="utf-8"))):
            outcome, started = Outcome(index), time.perf_counter()
            try:
                self._run_block(block, outcome)
            except Exception as error:
                message = str(error) if isinstance(error, PageError) else traceback.format_exc(limit=-4)
                raise PageError(f"{self.page.name}, line {block.first + 1}: {message}") from error
            longest = max((len(line) for text in outcome.texts for line in text.splitlines()), default=0)
            if longest > LONGEST_LINE:
                raise PageError(f"{self.page.name}, line {block.first + 1}: prints a line of {longest} characters")
            outcome.seconds = time.perf_counter() - started
            outcomes.append(outcome)
        return outcomes

    def _run_block(self, block: Block, outcome: Outcome) -> None:
        for line in block.marks.get("file", "").splitlines() if block.language != "show" else ():
            name, _, source = (part.strip() for part in line.partition("="))
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / source, self.folder / name)
        wanted = "needs" if "shell" not in block.marks else "shell"
        missing = [name for name in block.marks.get(wanted, "").replace(",", " ").split() if not _is_there(name)]
        if "not run" in block.marks:
            outcome.skipped = block.marks["not run"]
        elif self.small and "small" not in block.marks and block.language in ("python", "py", "console", "sh"):
            outcome.skipped = "for the long version"
        elif missing:
            outcome.skipped = f"{', '.join(missing)} not here"
        elif block.language in ("python", "py", "before"):
            self._python(block, outcome)
        elif block.language in ("console", "sh"):
            self._terminal(block, outcome)
        elif block.language == "text" and "said" in block.marks:
            _check_shown(block.text.splitlines(), self.printed)
        elif block.language == "yaml":
            check_yaml(block.text, block.marks.get("part of", ""), self.folder)
        elif block.language == "show":
            self._show(self.folder / block.marks["file"], outcome)

    def _python(self, block: Block, outcome: Outcome) -> None:
        # Empty lines before it, so that a traceback has the line of the page.
        tree = ast.parse("\n" * (block.first + 1) + block.text, str(self.page))
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.chdir(self.folder):
            exec(compile(tree, str(self.page), "exec"), self.names)
            if last is not None:
                value = eval(compile(ast.Expression(last.value), str(self.page), "eval"), self.names)
                self._value(value, outcome)
        outcome.texts.append(printed.getvalue())
        self.printed = printed.getvalue()

    def _value(self, value: Any, outcome: Outcome) -> None:
        """Show a value as a notebook shows the last line of a cell."""
        from matplotlib.figure import Figure

        from slidax.report.figures.style import save

        if isinstance(value, Figure):
            name = f"{self.page.stem}-{outcome.index}.svg"
            save(value, self.out / name)
            outcome.figures.append(name)
        elif value is not None:
            print(repr(value))

    def _terminal(self, block: Block, outcome: Outcome) -> None:
        if "shell" in block.marks:
            outcome.texts.append(self._bash(block))
            return
        typed = commands(block.language, block.text)
        for command in typed:
            if not command.is_ours:
                raise PageError(f"`{command.line}` is not slidax alone: mark the block `shell` or `not run`")
            text, code = self._ours([*command.arguments, *shlex.split(block.marks.get("with", ""))])
            outcome.texts.append(text)
            _check_shown(command.shown, text)
            if code != (int(block.marks.get("exit", "0")) if command is typed[-1] else 0):
                raise PageError(f"`{command.line}` left with exit code {code}:\n{text}")

    def _ours(self, arguments: list[str]) -> tuple[str, int]:
        from typer.testing import CliRunner

        from slidax.cli import app

        runner = CliRunner(env={"COLUMNS": str(COLUMNS), "TERM": "dumb", "NO_COLOR": "1"})
        with contextlib.chdir(self.folder):
            result = runner.invoke(app, arguments)
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result.output.replace(str(self.folder), "."), result.exit_code

    def _bash(self, block: Block) -> str:
        tools = self.folder / ".tools"
        tools.mkdir(exist_ok=True)
        script = tools / "slidax"
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "from slidax.cli import main; main()" "$@"\n')
        script.chmod(0o755)
        lines = (command.line for command in commands(block.language, block.text))
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", "\n".join(lines)],
            cwd=self.folder,
            env=os.environ | {"PATH": f"{tools}:{os.environ['PATH']}", "COLUMNS": str(COLUMNS)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode != int(block.marks.get("exit", "0")):
            raise PageError(f"exit code {done.returncode}:\n{done.stdout[-3000:]}")
        return done.stdout.replace(str(self.folder), ".")

    def _show(self, path: Path, outcome: Outcome) -> None:
        if self.small:
            return
        if not path.exists():
            raise PageError(
                f"there is no `{path.name}` to show; there are {sorted(p.name for p in path.parent.glob('*'))}"
            )
        name = f"{self.page.stem}-{outcome.index}{path.suffix}"
        shutil.copy(path, self.out / name)
        outcome.figures.append(name)


def _check_shown(shown: list[str], printed: str) -> None:
    """Check that the lines of the page were printed; line breaks depend on the terminal."""
    whole = " ".join(printed.split())
    for line in shown:
        if " ".join(line.split()) not in whole:
            raise PageError(f"the page shows {line.strip()!r}, which was not printed; that was:\n{printed}")


def _is_there(name: str) -> bool:
    return shutil.which(name) is not None or importlib.util.find_spec(name) is not None


STORE = ROOT / "build" / "pages"
SOURCES = ("src/slidax", "examples", "scripts/documentation/pages.py", "scripts/documentation/commands.py")
PACKAGES = ("jax", "numpy", "scipy", "matplotlib", "llvmlite", "mujoco")


@dataclass
class PageResult:
    """Results of a page's code.

    - `outcomes`: of its blocks, as in `Outcome`.
    - `figures`: the files of its figures.
    """

    outcomes: list[dict[str, Any]] = field(default_factory=list)
    figures: list[Path] = field(default_factory=list)


def pages() -> list[str]:
    """The pages of docs/ with code, by their place there."""
    paths = sorted((ROOT / "docs").rglob("*.md"))
    return [
        path.relative_to(ROOT / "docs").as_posix()
        for path in paths
        if "api" not in path.parts and blocks(path.read_text(encoding="utf-8"))
    ]


def run_all(jobs: int, only: list[str] | None) -> tuple[dict[str, PageResult], list[str]]:
    """Run the code of all pages or of some: results by page, and messages of pages that fail.

    - `jobs`: number of pages that run at a time.
    """
    names = [name for name in pages() if only is None or name in only or Path(name).stem in only]
    results: dict[str, PageResult] = {}
    failed: list[str] = []
    with ThreadPoolExecutor(jobs) as pool:
        for name, result in zip(names, pool.map(_run_page, names), strict=True):
            if isinstance(result, str):
                failed.append(f"docs/{name}: {result}")
            else:
                results[name] = result
    return results, failed


def _run_page(name: str) -> PageResult | str:
    page = ROOT / "docs" / name
    # Pages of different folders may have one name.
    slug = name.removesuffix(".md").replace("/", ".")
    folder = STORE / f"{slug}-{_key(page)}"
    if not (folder / "outcomes.json").exists():
        started = time.perf_counter()
        for old in STORE.glob(f"{slug}-" + "?" * 16):
            shutil.rmtree(old)
        folder.mkdir(parents=True)
        done = subprocess.run(
            [sys.executable, "-X", "utf8", "-m", "documentation.pages", page, "--out", folder],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT / 'scripts'}", "PYTHONDONTWRITEBYTECODE": "1"},
        )
        if done.returncode:
            return done.stderr[-4000:]
        print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)
    outcomes = json.loads((folder / "outcomes.json").read_text(encoding="utf-8"))
    return PageResult(outcomes, [folder / figure for outcome in outcomes for figure in outcome["figures"]])


def _key(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    parts = [(block.language, block.text, sorted(block.marks.items())) for block in blocks(text)]
    return hashlib.sha256(f"{parts}{sources()}".encode()).hexdigest()[:16]


@cache
def sources() -> str:
    """A digest of everything that the code of a page calls."""
    digest = hashlib.sha256(sys.version.encode())
    for name in PACKAGES:
        try:
            digest.update(f"{name} {metadata.version(name)}".encode())
        except metadata.PackageNotFoundError:
            digest.update(f"no {name}".encode())
    for source in SOURCES:
        for path in sorted((ROOT / source).rglob("*")) or [ROOT / source]:
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(path.relative_to(ROOT).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def main() -> None:
    """Run the code of one page in an empty folder, and write its outcomes; an error names its line."""
    import matplotlib as mpl

    mpl.use("agg")
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("page", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="a folder for figures and outcomes.json")
    parser.add_argument("--small", action="store_true", help="only blocks marked as small")
    options = parser.parse_args()
    # A reader has the extras of the first page and those that this one names.
    for module in modules_of_other_extras(START.read_text(encoding="utf-8") + options.page.read_text(encoding="utf-8")):
        sys.modules[module] = None  # type: ignore[assignment]
    # The same figure in the same bits.
    mpl.rcParams["svg.hashsalt"] = options.page.stem
    with tempfile.TemporaryDirectory() as folder:
        try:
            outcomes = PageRun(options.page.resolve(), Path(folder), options.out.resolve(), options.small).run()
        except PageError as error:
            print(error, file=sys.stderr)
            raise SystemExit(1) from None
    text = json.dumps([dataclasses.asdict(outcome) for outcome in outcomes], ensure_ascii=False, indent=1)
    (options.out / "outcomes.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
