"""The blocks of code of a page: marks, commands and parts of files."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

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


class PageError(Exception):
    """A page is not as it should be."""


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


READ = {".yaml", ".yml", ".urdf", ".xml", ".mjcf", ".csv", ".json", ".mcap", ".parquet"}
"""Endings of files that commands read."""

WRITTEN = {"--out", "--record", "--log", "--histogram", "--report"}
"""Options whose value is written, unless it is there."""


@dataclass(frozen=True)
class Command:
    """A line that a reader types, and what the page shows below it.

    - `line`: without the prompt.
    - `shown`: the lines below it.
    """

    line: str
    shown: list[str] = field(default_factory=list)

    @property
    def arguments(self) -> list[str]:
        """Words after `slidax`, or all words of another program's command."""
        words = shlex.split(self.line, comments=True)
        return words[1:] if self.is_ours else words

    @property
    def is_ours(self) -> bool:
        """True if the line is one `slidax` command, without another program."""
        words = shlex.split(self.line, comments=True)
        return bool(words) and words[0] == "slidax" and not {"&&", "|", ">", ";"} & set(words)


def commands(language: str, text: str) -> list[Command]:
    """The commands of a block: after the prompt `$` in a `console`, every line in `sh`."""
    typed: list[Command] = []
    joined = text.replace("\\\n", " ")
    for line in joined.splitlines():
        if language == "console":
            if line.startswith("$ "):
                typed.append(Command(line[2:].strip()))
            elif typed:
                typed[-1].shown.append(line)
        elif line.strip() and not line.lstrip().startswith("#"):
            typed.append(Command(line.strip()))
    return typed


def check(arguments: list[str], app: Any) -> None:
    """Check that the command line takes these arguments; nothing is run.

    Raises PageError if there is no such command or option, or an argument is missing.
    """
    from typer.main import get_command

    command: Any = get_command(app)
    words, context = list(arguments), None
    try:
        while True:
            context = command.make_context("slidax", words, parent=context)
            if not hasattr(command, "resolve_command"):
                return
            rest = [*getattr(context, "_protected_args", []), *context.args]
            _, command, words = command.resolve_command(context, rest)
    except SystemExit:
        return
    except Exception as error:
        # `--help` and `--version` leave by an exception of their own.
        if type(error).__name__ in ("Exit", "NoArgsIsHelpError"):
            return
        message = getattr(error, "format_message", lambda: str(error))()
        raise PageError(f"`slidax {shlex.join(arguments)}`: {message}") from error


@dataclass
class Files:
    """Which files a reader has at a place of the page.

    - `folder`: where a reader stands: the root of a clone.
    - `written`: what the page has written before.
    """

    folder: Path
    written: set[str] = field(default_factory=set)

    def has(self, name: str) -> bool:
        """True if a file exists, or is in a folder that a command of the page has written."""
        path = Path(name)
        parents = {str(parent) for parent in path.parents} - {"."}
        return name in self.written or bool(parents & self.written) or (self.folder / path).exists()

    def follow(self, arguments: list[str]) -> None:
        """Note what a command writes, and looks for what it reads.

        Raises PageError if a file is nowhere.
        """
        before = ""
        for word in arguments:
            value = word.split("=", 1)[-1] if word.startswith("--") or "=" in word else word
            option = word.split("=", 1)[0] if word.startswith("--") and "=" in word else before
            if option in WRITTEN:
                self.written.add(value.rstrip("/"))
            elif Path(value).suffix in READ and not self.has(value):
                raise PageError(f"`{value}` is neither in the repository nor written before on this page")
            before = word


PATHS = ("truth", "uncertainty")
"""Blocks of a scenario whose keys are paths themselves."""


def check_yaml(text: str, part_of: str, folder: Path) -> None:
    """Read a block as slidax reads such a file; a block whose first line is `# NAME.yaml` is written down as well.

    - `part_of`: the built-in scenario whose part it is; `unread` if only its YAML is read; empty for a whole file.

    Raises PageError if it is not whole and no scenario is named, DefinitionError if slidax refuses it.
    """
    from slidax.scenarios import parse
    from slidax.scenarios.load import read_yaml

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
