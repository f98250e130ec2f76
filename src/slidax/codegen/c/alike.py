"""Expressions that differ in their operands alone, and how those are found one after the other."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

LEAST = 3
"""As many turns as a loop is worth."""

WORD = re.compile(
    r"(?<![\w.>])(?:"
    r"[A-Za-z_]\w*+(?:->\w++)?(?:\[\d+\])?(?![\w(\[>-]*+\()(?!->)"
    r"|(?:0x[\da-fA-F.]+(?:p[+-]?\d+)?|\d+\.?\d*(?:e[+-]?\d+)?)[fuUlL]*+"
    r")"
)
ELEMENT = re.compile(r"([A-Za-z_]\w*(?:->\w+)?)\[(\d+)\]")

Stored = dict[str, tuple[str, int]]
"""By name, the array and the place in it that a number has become."""

Operands = Sequence[str]


@dataclass(frozen=True)
class Piece:
    """An expression.

    - `text`: itself.
    - `template`: the text with a mark for each operand.
    - `operands`: variables, elements of arrays, and numbers, in order.
    """

    text: str
    template: str
    operands: tuple[str, ...]

    def filled(self, texts: Sequence[str]) -> str:
        """The expression with other operands.

        - `texts`: as many.
        """
        parts = self.template.split("\0")
        return parts[0] + "".join(text + part for text, part in zip(texts, parts[1:], strict=True))

    def written(self, renamed: Callable[[str], str]) -> str:
        """The expression with its operands renamed.

        - `renamed`: from an operand to another.
        """
        return self.filled([renamed(word) for word in self.operands])


def parsed(text: str) -> Piece:
    """An expression, or any line of C.

    - `text`: it.
    """
    return Piece(text, WORD.sub("\0", text), tuple(WORD.findall(text)))


@dataclass(frozen=True)
class Access:
    """How an operand is found in turn i: `array[start + step i]`.

    - `array`, `start`, `step`: of the element; a step of 0: the same in all turns.
    - `text`: of what is the same in all turns, and is no element.
    - `numbers`: known numbers, one for each turn.
    """

    array: str = ""
    start: int = 0
    step: int = 0
    text: str = ""
    numbers: tuple[str, ...] = ()

    def element(self, index: str) -> str:
        """The element in C.

        - `index`: the variable of the loop.
        """
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
        """Where the first element lies, in C."""
        return f"&{self.array}[{self.start}]" if self.start else self.array


def accesses(rows: Sequence[Operands], stored: Stored) -> tuple[int, list[Access]]:
    """How many of some expressions, from the first on, are the turns of one loop; and how each operand is found.

    - `rows`: the operands of each expression.
    - `stored`: numbers that have become elements of arrays.
    """
    count = len(rows)
    columns = list(zip(*rows, strict=True))
    for column in columns:
        count = min(count, _alike(column[:count], stored))
        if count < LEAST:
            return count, []
    return count, [_access(column[:count], stored) for column in columns]


def _place(word: str, stored: Stored) -> tuple[str, int] | None:
    if word in stored:
        return stored[word]
    match = ELEMENT.fullmatch(word)
    return None if match is None else (match.group(1), int(match.group(2)))


def _alike(column: Sequence[str], stored: Stored) -> int:
    """How many operands, from the first on, can be found by one rule."""
    if len(column) < 2:
        return len(column)
    first = column[0]
    if column[1] == first:
        return next((k for k, word in enumerate(column) if word != first), len(column))
    one, two = _place(first, stored), _place(column[1], stored)
    if one is not None and two is not None and one[0] == two[0]:
        step = two[1] - one[1]
        wanted = ((one[0], one[1] + k * step) for k in range(len(column)))
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
