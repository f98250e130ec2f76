"""Expressions that differ in their operands alone, and the rule by which a loop finds the operands."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

LEAST = 3
"""Smallest number of iterations that is worth a loop."""

WORD = re.compile(
    r"(?<![\w.>])(?:"
    r"[A-Za-z_]\w*+(?:->\w++)?(?:\[\d+\])?(?![\w(\[>-]*+\()(?!->)"
    r"|(?:0x[\da-fA-F.]+(?:p[+-]?\d+)?|\d+\.?\d*(?:e[+-]?\d+)?)[fuUlL]*+"
    r")"
)
ELEMENT = re.compile(r"([A-Za-z_]\w*(?:->\w+)?)\[(\d+)\]")

Stored = dict[str, tuple[str, int]]
"""Array and index of each value that has become an element, by the value's name."""

Operands = Sequence[str]


@dataclass(frozen=True)
class Piece:
    """An expression.

    - `template`: the text with a mark in place of each operand.
    - `operands`: variables, elements of arrays, and numbers, in order.
    """

    text: str
    template: str
    operands: tuple[str, ...]

    def fill(self, texts: Sequence[str]) -> str:
        """Return the expression with other operands."""
        parts = self.template.split("\0")
        return parts[0] + "".join(text + part for text, part in zip(texts, parts[1:], strict=True))

    def with_operands(self, rename: Callable[[str], str]) -> str:
        """Return the expression with each operand renamed."""
        return self.fill([rename(word) for word in self.operands])


def parse(text: str) -> Piece:
    """Split an expression, or any line of C, into template and operands."""
    return Piece(text, WORD.sub("\0", text), tuple(WORD.findall(text)))


@dataclass(frozen=True)
class Access:
    """Rule for an operand in iteration i: `array[start + step i]`.

    - `array`, `start`, `step`: the element; step 0: the same in all iterations.
    - `text`: an operand that is the same in all iterations, and no element.
    - `numbers`: constants, one for each iteration.
    """

    array: str = ""
    start: int = 0
    step: int = 0
    text: str = ""
    numbers: tuple[str, ...] = ()

    def element(self, index: str) -> str:
        """Return the element as C text; `index` is the variable of the loop."""
        if self.step == 1:
            return f"{self.array}[{index} + {self.start}]" if self.start else f"{self.array}[{index}]"
        if self.step > 0 and not self.start:
            return f"{self.array}[{self.step} * {index}]"
        if self.step == -1:
            return f"{self.array}[{self.start} - {index}]"
        if self.step < 0:
            return f"{self.array}[{self.start} - {-self.step} * {index}]"
        return f"{self.array}[{self.step} * {index} + {self.start}]"

    def pointer(self) -> str:
        """Return a pointer to the first element, as C text."""
        return f"&{self.array}[{self.start}]" if self.start else self.array


def find_accesses(rows: Sequence[Operands], stored: Stored) -> tuple[int, list[Access]]:
    """Count the expressions, from the first on, that one loop can compute, and return the rule for each operand.

    - `rows`: operands of each expression.
    - `stored`: values that have become elements of arrays.
    """
    count = len(rows)
    columns = list(zip(*rows, strict=True))
    for column in columns:
        count = min(count, _count_alike(column[:count], stored))
        if count < LEAST:
            return count, []
    return count, [_access(column[:count], stored) for column in columns]


def _place(word: str, stored: Stored) -> tuple[str, int] | None:
    if word in stored:
        return stored[word]
    match = ELEMENT.fullmatch(word)
    return None if match is None else (match.group(1), int(match.group(2)))


def _count_alike(column: Sequence[str], stored: Stored) -> int:
    """Number of operands, from the first on, that follow one rule."""
    if len(column) < 2:
        return len(column)
    first = column[0]
    if column[1] == first:
        return next((k for k, word in enumerate(column) if word != first), len(column))
    start, second = _place(first, stored), _place(column[1], stored)
    if start is not None and second is not None and start[0] == second[0]:
        step = second[1] - start[1]
        wanted = ((start[0], start[1] + k * step) for k in range(len(column)))
        return next(
            (k for k, (word, place) in enumerate(zip(column, wanted, strict=True)) if _place(word, stored) != place),
            len(column),
        )
    return next((k for k, word in enumerate(column) if not word[0].isdigit()), len(column))


def _access(column: Sequence[str], stored: Stored) -> Access:
    first = column[0]
    place = _place(first, stored)
    if all(word == first for word in column):
        return Access("" if place is None else place[0], 0 if place is None else place[1], text=first)
    if place is None:
        return Access(numbers=tuple(column))
    second = _place(column[1], stored)
    assert second is not None
    return Access(place[0], place[1], second[1] - place[1])
