"""Similar statements, which differ only in their operands, and their order.

A group of similar statements can become a loop. A lane is one of its statements, which is one iteration of the loop.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from .layout import ELEMENT, CodeLine

LEAST = 3
"""Smallest number of iterations that is worth a loop."""

WORD = re.compile(
    r"(?<![\w.>])(?:"
    r"[A-Za-z_]\w*+(?:->\w++)?(?:\[\d+\])?(?![\w(\[>-]*+\()(?!->)"
    r"|(?:0x[\da-fA-F.]+(?:p[+-]?\d+)?|\d+\.?\d*(?:e[+-]?\d+)?)[fuUlL]*+"
    r")"
)

Stored = dict[str, tuple[str, int]]
"""For each variable that has become an array element, by its name, the array and the index."""

Operands = Sequence[str]


@dataclass(frozen=True)
class Piece:
    """A C expression, split into template and operands; similar expressions have the same template.

    - `template`: the text with a mark in place of each operand.
    - `operands`: variables, elements of arrays, and numbers, in order.
    """

    text: str
    template: str
    operands: tuple[str, ...]

    def fill(self, texts: Sequence[str]) -> str:
        """Return the C text of the expression with other operands."""
        parts = self.template.split("\0")
        return parts[0] + "".join(text + part for text, part in zip(texts, parts[1:], strict=True))


def parse(text: str) -> Piece:
    """Split a C expression, or any line of C, into template and operands."""
    return Piece(text, WORD.sub("\0", text), tuple(WORD.findall(text)))


@dataclass(frozen=True)
class Access:
    """Rule for one operand of a loop's expression: an array element, a fixed text, or a list of numbers.

    - `array`, `start`, `step`: in iteration i the operand is `array[start + step i]`; empty if it is no array element.
    - `text`: an operand that is the same in all iterations.
    - `numbers`: the operand's values if it is a different number in each iteration.
    """

    array: str = ""
    start: int = 0
    step: int = 0
    text: str = ""
    numbers: tuple[str, ...] = ()

    def element(self, index: str) -> str:
        """Return the C text of the array element; `index` is the name of the loop's counter."""
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
        """Return the C text of a pointer to the element that the first iteration accesses."""
        return f"&{self.array}[{self.start}]" if self.start else self.array


def find_accesses(rows: Sequence[Operands], stored: Stored) -> tuple[int, list[Access]]:
    """Return how many expressions, from the first one on, a single loop can compute, and a rule for each operand.

    The list of rules is empty if there are fewer than `LEAST` such expressions.

    - `rows`: operands of each expression; all expressions have the same template.
    - `stored`: for each variable that has become an array element, by its name, the array and the index.
    """
    count = len(rows)
    columns = list(zip(*rows, strict=True))
    for column in columns:
        count = min(count, _count_alike(column[:count], stored))
        if count < LEAST:
            return count, []
    return count, [_access(column[:count], stored) for column in columns]


def _element_of(word: str, stored: Stored) -> tuple[str, int] | None:
    if word in stored:
        return stored[word]
    match = ELEMENT.fullmatch(word)
    return None if match is None else (match.group(1), int(match.group(2)))


def _count_alike(column: Sequence[str], stored: Stored) -> int:
    """Return the number of leading operands that follow one rule."""
    if len(column) < 2:
        return len(column)
    first = column[0]
    if column[1] == first:
        return next((k for k, word in enumerate(column) if word != first), len(column))
    start, second = _element_of(first, stored), _element_of(column[1], stored)
    if start is not None and second is not None and start[0] == second[0]:
        step = second[1] - start[1]
        differing = (k for k, word in enumerate(column) if _element_of(word, stored) != (start[0], start[1] + k * step))
        return next(differing, len(column))
    return next((k for k, word in enumerate(column) if not word[0].isdigit()), len(column))


def _access(column: Sequence[str], stored: Stored) -> Access:
    first = column[0]
    place = _element_of(first, stored)
    if all(word == first for word in column):
        return Access("" if place is None else place[0], 0 if place is None else place[1], text=first)
    if place is None:
        return Access(numbers=tuple(column))
    second = _element_of(column[1], stored)
    assert second is not None
    return Access(place[0], place[1], second[1] - place[1])


@dataclass(eq=False)
class Statement:
    """A declaration or an assignment in C.

    - `index`: number of its line in the function.
    - `type`, `name`: type and name of the declared variable. For an assignment, `type` is empty and `name` its target.
    - `piece`: its expression.
    """

    line: CodeLine
    index: int
    type: str
    name: str
    piece: Piece


@dataclass(eq=False)
class Group:
    """Statements that one loop computes, or a single statement, in C.

    - `lanes`: the statements, in order.
    - `array`: array in which their values are stored; empty for a single statement with its own variable.
    - `at`: for each operand, the rule for its array element in an iteration (see `Access`).
    - `target`: the same rule for the computed value; None for a single statement.
    """

    lanes: list[Statement]
    array: str = ""
    at: Sequence[Access] = ()
    target: Access | None = None

    @property
    def iterations(self) -> int:
        """Number of iterations of its loop."""
        return 1 if self.target is None else len(self.lanes)

    @property
    def looks_back(self) -> bool:
        """True if an iteration needs the value of an earlier one."""
        names = {lane.name for lane in self.lanes}
        return any(word in names for lane in self.lanes for word in lane.piece.operands)


def order_groups(groups: list[Group]) -> list[Group]:
    """Return the groups, ordered so that each value is computed before its use.

    A group that prevents such an order is split into single statements.
    """
    maker = {lane.name: group for group in groups for lane in group.lanes}
    order: list[Group] = []
    while True:
        missing: dict[int, set[int]] = {}
        users: defaultdict[int, list[Group]] = defaultdict(list)
        for group in groups:
            needs = {id(maker[word]) for lane in group.lanes for word in lane.piece.operands if word in maker}
            # Iterations keep the order of the statements, which need earlier ones only.
            missing[id(group)] = needs - {id(group)}
            for need in needs:
                users[need].append(group)
        ready = [group for group in groups if not missing[id(group)]]
        order, done = [], set()
        while ready:
            group = _next(ready, order)
            ready.remove(group)
            order.append(group)
            done.add(id(group))
            for user in users[id(group)]:
                missing[id(user)].discard(id(group))
                if not missing[id(user)] and id(user) not in done and user not in ready:
                    ready.append(user)
        stuck = [group for group in groups if id(group) not in done and len(group.lanes) > 1]
        if len(order) == len(groups):
            return order
        broken = min(stuck, key=lambda group: group.lanes[0].index)
        groups.remove(broken)
        for lane in broken.lanes:
            single = Group([lane], broken.array)
            groups.append(single)
            maker[lane.name] = single


def _next(ready: list[Group], order: list[Group]) -> Group:
    """Choose the next group: a loop with as many iterations as the last loop, else a single statement, else a loop.

    If several qualify, the first in the source is chosen.
    """
    if order and order[-1].target is not None:
        same = [group for group in ready if group.iterations == order[-1].iterations]
        if same:
            return min(same, key=lambda group: group.lanes[0].index)
    return min(ready, key=lambda group: (len(group.lanes) > 1, group.lanes[0].index))


def fits_loop(group: Group, loop: list[Group]) -> bool:
    """True if a loop can compute a further group of statements.

    The group must have as many iterations as the loop. It may read the values that an iteration of the loop computes
    only in the same iteration.

    - `loop`: groups that the loop computes already.
    """
    if group.target is None or group.iterations != loop[0].iterations:
        return False
    targets = {other.target for other in loop}
    elements = {element for other in loop for element in _elements(other.target, other.iterations)}
    return all(access in targets or not elements & _elements(access, group.iterations) for access in group.at)


def _elements(access: Access | None, iterations: int) -> set[tuple[str, int]]:
    """Return the elements that the iterations of a loop access."""
    if access is None or not access.array:
        return set()
    return {(access.array, access.start + i * access.step) for i in range(iterations)}
