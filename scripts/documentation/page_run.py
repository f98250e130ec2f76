"""A page, run as a reader would: its files, its code and its commands, in their order."""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import io
import os
import shlex
import shutil
import subprocess
import sys
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .blocks import Block, PageError, blocks
from .commands import commands
from .parts_of_files import check_yaml

ROOT = Path(__file__).parents[2]
COLUMNS = 110


@dataclass
class Outcome:
    """What a block has made.

    - `index`: of the block on the page.
    - `texts`: what was printed, after each of its commands, or once for Python.
    - `figures`: files, in the folder of the outputs.
    - `skipped`: why it was not run; empty if it was.
    - `seconds`: how long it took.
    """

    index: int
    texts: list[str] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)
    skipped: str = ""
    seconds: float = 0.0


class PageRun:
    """Runs the blocks of a page in a folder of its own, with one namespace for all Python.

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
        found = []
        for index, block in enumerate(blocks(self.page.read_text(encoding="utf-8"))):
            outcome, started = Outcome(index), time.perf_counter()
            try:
                self._one(block, outcome)
            except Exception as error:
                said = str(error) if isinstance(error, PageError) else traceback.format_exc(limit=-4)
                raise PageError(f"{self.page.name}, line {block.first + 1}: {said}") from error
            outcome.seconds = time.perf_counter() - started
            found.append(outcome)
        return found

    def _one(self, block: Block, outcome: Outcome) -> None:
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
            _same(block.text.splitlines(), self.printed)
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
        """As a notebook shows the last line of a cell."""
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
            _same(command.shown, text)
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
        lines = (one.line for one in commands(block.language, block.text))
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


def _same(shown: list[str], said: str) -> None:
    """That what a page shows is what was printed; where a line is broken depends on the terminal.

    - `shown`: the lines of the page.
    - `said`: what was printed.
    """
    whole = " ".join(said.split())
    for line in shown:
        if " ".join(line.split()) not in whole:
            raise PageError(f"the page shows {line.strip()!r}, which was not printed; that was:\n{said}")


def _is_there(name: str) -> bool:
    return shutil.which(name) is not None or importlib.util.find_spec(name) is not None
