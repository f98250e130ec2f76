"""Similar statements, which differ only in their operands, and their order."""

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
"""Array and index of each value that has become an element, by the value's name."""

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
    """Rule for one operand of a loop's expression: in iteration i it is `array[start + step i]`.

    - `array`, `start`, `step`: the element; step 0 for the same element in all iterations.
    - `text`: an operand that is equal in all iterations, and not an element.
    - `numbers`: constants, one for each iteration.
    """

    array: str = ""
    start: int = 0
    step: int = 0
    text: str = ""
    numbers: tuple[str, ...] = ()

    def element(self, index: str) -> str:
        """Return the C text of the array element in an iteration; `index` is the variable of the loop."""
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
        """Return the C text of a pointer to the element of the first iteration."""
        return f"&{self.array}[{self.start}]" if self.start else self.array


def find_accesses(rows: Sequence[Operands], stored: Stored) -> tuple[int, list[Access]]:
    """Return the number of leading expressions that one loop can compute, and the rule for each operand.

    The list of rules is empty if these are fewer than `LEAST` expressions.

    - `rows`: operands of each expression; all expressions have the same template.
    - `stored`: array and index of each value that has become an element, by the value's name.
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
    - `type`, `name`: type and name of the declared variable; for an assignment, empty and its target.
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
    - `array`: array of their values; empty for a single statement with its own variable.
    - `at`: array element of each operand, as a function of the iteration.
    - `target`: array element of the computed value, as a function of the iteration; None for a single statement.
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
    """Choose the next group: a loop with as many iterations as the last loop, else the first group in the source."""
    if order and order[-1].target is not None:
        same = [group for group in ready if group.iterations == order[-1].iterations]
        if same:
            return min(same, key=lambda group: group.lanes[0].index)
    return min(ready, key=lambda group: (len(group.lanes) > 1, group.lanes[0].index))


def fits_loop(group: Group, loop: list[Group]) -> bool:
    """True if a loop can compute one more group, which has as many iterations.

    The group must read values of the loop only from the same iteration.

    - `loop`: groups that the loop computes.
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
