"""Lines of C in the making: how they are indented, and where a comment says what they are about."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

INDENT = "    "
WIDTH = 100
MARKS = (", ", " + ", " - ", " * ", " && ", " || ", " ? ", " : ", " = ")
"""Where a line may be broken."""

JOINTS = (" && ", " || ")
"""Where it is broken best."""

DECLARED = re.compile(r"(double|float|bool|u?int(?:32|64)_t) \w+(?:\[\d+\])?(?:, \w+(?:\[\d+\])?)*;")
"""Variables of one type that have no value yet."""

MORE = 10
"""Letters that a line may have beyond that before it is broken."""


@dataclass(frozen=True)
class Line:
    """One line.

    - `level`: how deep it is indented.
    - `text`: the rest.
    - `about`: what it computes, as a comment; empty for lines that compute nothing.
    - `visit`: equal for lines of one operation on arrays; None for others.
    - `element`: the number of the array, and the place in it, that a declared number should have.
    """

    level: int
    text: str
    about: str = ""
    visit: object = None
    element: tuple[int, int] | None = None


def laid_out(lines: list[Line]) -> list[str]:
    """The lines as text, with a comment before each two or more about the same that differ from those before.

    What has been said once is then told by its first words, up to the colon.

    - `lines`: in order.
    """
    texts: list[str] = []
    last = ""
    told: set[str] = set()
    for run in _runs(lines):
        about, level = run[0].about, run[0].level
        if about and about != last and len(run) > 1:
            if texts and not texts[-1].endswith("{"):
                texts.append("")
            texts += _comment(about.partition(":")[0] if about in told else about, level)
            told.add(about)
            last = about
        for line in run:
            texts += _broken(line)
    return texts


def declared_together(lines: list[Line]) -> list[Line]:
    """The lines with one declaration for what is declared together, of one type and without a value.

    - `lines`: in order.
    """
    out: list[Line] = []
    for line in lines:
        last = out[-1] if out else line
        match, before = DECLARED.fullmatch(line.text), DECLARED.fullmatch(last.text)
        together = match is not None and before is not None and match.group(1) == before.group(1)
        if out and together and (line.level, line.about) == (last.level, last.about):
            text = f"{last.text[:-1]}, {line.text.partition(' ')[2]}"
            if len(INDENT) * line.level + len(text) <= WIDTH:
                out[-1] = Line(line.level, text, line.about)
                continue
        out.append(line)
    return out


def _broken(line: Line) -> list[str]:
    """A line as text, in several where it is too long."""
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


def _runs(lines: list[Line]) -> Iterator[list[Line]]:
    """Lines about the same, at the same level, one after the other."""
    run: list[Line] = []
    for line in lines:
        if run and (line.about, line.level) != (run[-1].about, run[-1].level):
            yield run
            run = []
        run.append(line)
    if run:
        yield run
