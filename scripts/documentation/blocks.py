"""The blocks of code of a page, and the marks that say how each is run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

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
"""What may stand in a comment before a block, as `<!-- mark: value -->`."""


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

    - `text`: of the page.

    Raises PageError for an open fence, or a mark that nothing follows.
    """
    return list(_found(text.split("\n")))


def _found(lines: list[str]) -> Iterator[Block]:
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
            said = comment[1] if comment else ""
            if hidden := HIDDEN.fullmatch(said):
                yield Block("before", hidden[1], row, end)
            elif shown := SHOW.fullmatch(said):
                yield Block("show", shown[2], row, end, {"file": shown[1]})
            elif named := NAMED.fullmatch(said):
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
            body = "".join(f"{one.removeprefix(fence[1])}\n" for one in lines[start + 1 : row])
            yield Block(fence[3], body, marked if marks else start, row, marks)
            marks = {}
        elif line.strip() and marks:
            raise PageError(f"line {marked + 1}: a mark, {next(iter(marks))!r}, with no block after it")
        row += 1
    if marks:
        raise PageError(f"line {marked + 1}: a mark, {next(iter(marks))!r}, with no block after it")
