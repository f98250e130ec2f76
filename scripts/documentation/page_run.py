"""Run the code of pages as a reader would; an unchanged page is not run again."""

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
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from .blocks import Block, PageError, blocks, check_yaml, commands

ROOT = Path(__file__).parents[2]
COLUMNS = 110


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

        if isinstance(value, Figure):
            name = f"{self.page.stem}-{outcome.index}.svg"
            value.savefig(self.out / name)
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
        import jax
        from typer.testing import CliRunner

        from slidax.cli import app

        before = jax.config.jax_enable_x64
        runner = CliRunner(env={"COLUMNS": str(COLUMNS), "TERM": "dumb", "NO_COLOR": "1"})
        with contextlib.chdir(self.folder):
            result = runner.invoke(app, arguments)
        # The command line switches 64-bit numbers on for its own process; code on the page must do so itself.
        jax.config.update("jax_enable_x64", before)
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
SOURCES = ("src/slidax", "examples", "scripts/documentation/blocks.py", "scripts/documentation/page_run.py")
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
            [sys.executable, "-X", "utf8", "-m", "documentation.page_run", page, "--out", folder],
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
