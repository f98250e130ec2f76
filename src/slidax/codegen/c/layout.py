"""Lines of C: indentation, line breaks, and a comment on the values that they compute."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

INDENT = "    "
WIDTH = 100
MARKS = (", ", " + ", " - ", " * ", " && ", " || ", " ? ", " : ", " = ")
"""Places where a line may be broken."""

JOINTS = (" && ", " || ")
"""Preferred places."""

UNINITIALISED = re.compile(r"(double|float|bool|u?int(?:32|64)_t) \w+(?:\[\d+\])?(?:, \w+(?:\[\d+\])?)*;")
"""Declaration of variables of one type without a value."""

MORE = 10
"""Excess characters up to which a line is not broken."""


@dataclass(frozen=True)
class CodeLine:
    """One line.

    - `level`: depth of indentation.
    - `text`: without indentation.
    - `about`: comment on the computed value; empty for lines without one.
    - `visit`: equal for lines of one operation on arrays; None for others.
    - `element`: number of an array, and the index in it, for the declared value.
    """

    level: int
    text: str
    about: str = ""
    visit: object = None
    element: tuple[int, int] | None = None


def format_lines(lines: list[CodeLine]) -> list[str]:
    """Return the lines as text, with a comment before two or more lines about a new subject.

    A repeated comment is cut after its first words, at the colon.
    """
    texts: list[str] = []
    last = ""
    commented: set[str] = set()
    for run in _runs(lines):
        about, level = run[0].about, run[0].level
        if about and about != last and len(run) > 1:
            if texts and not texts[-1].endswith("{"):
                texts.append("")
            texts += _comment(about.partition(":")[0] if about in commented else about, level)
            commented.add(about)
            last = about
        for line in run:
            texts += _break_line(line)
    return texts


def join_declarations(lines: list[CodeLine]) -> list[CodeLine]:
    """Return the lines with adjacent declarations of one type, without a value, joined."""
    out: list[CodeLine] = []
    for line in lines:
        last = out[-1] if out else line
        match, before = UNINITIALISED.fullmatch(line.text), UNINITIALISED.fullmatch(last.text)
        together = match is not None and before is not None and match.group(1) == before.group(1)
        if out and together and (line.level, line.about) == (last.level, last.about):
            text = f"{last.text[:-1]}, {line.text.partition(' ')[2]}"
            if len(INDENT) * line.level + len(text) <= WIDTH:
                out[-1] = CodeLine(line.level, text, line.about)
                continue
        out.append(line)
    return out


def _break_line(line: CodeLine) -> list[str]:
    """A line as text, broken where it is too long."""
    text, before = line.text, INDENT * line.level
    texts: list[str] = []
    while len(before) + len(text) > WIDTH + MORE:
        room = WIDTH - len(before)
        at = max(text.rfind(mark, 0, room) for mark in JOINTS)
        if at < room // 2:
            at = max(text.rfind(mark, 0, room) for mark in MARKS)
        if at <= 0:
            break
        at += 1 if text[at] == "," else 2 if text[at + 1] == "=" else 0
        texts.append(before + text[:at])
        before, text = INDENT * (line.level + 1), text[at:].lstrip()
    return [*texts, before + text if text else ""]


def _comment(text: str, level: int) -> list[str]:
    before = INDENT * level
    # The number of an equation stays with its "eq.".
    held = re.sub(r"(eqs?\.) \(", "\\1\0(", text)
    lines = [line.replace("\0", " ") for line in textwrap.wrap(held, WIDTH - len(before) - len("/*  */"))]
    lines[0] = f"{before}/* {lines[0]}"
    lines[1:] = [f"{before} * {line}" for line in lines[1:]]
    lines[-1] += " */"
    return lines


def _runs(lines: list[CodeLine]) -> Iterator[list[CodeLine]]:
    """Adjacent lines with one comment and level."""
    run: list[CodeLine] = []
    for line in lines:
        if run and (line.about, line.level) != (run[-1].about, run[-1].level):
            yield run
            run = []
        run.append(line)
    if run:
        yield run
