"""Upper bounds on the iterations of a loop and on the operations of a program."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from .ir import ELEMENTARY, Branch, Call, Loop, Program, Region, Value

FREE = frozenset({"const", "input", "param", "result", "copy", "bitcast"})
"""Operations that cost nothing."""


class Longest(NamedTuple):
    """Largest number of operations of a program.

    - `operations`: additions, products, comparisons, choices, elementary functions and so on.
    - `elementary`: elementary functions among them.
    """

    operations: int
    elementary: int

    def __str__(self) -> str:
        return f"{self.operations}, {self.elementary} of them elementary functions"

    def __add__(self, other: object) -> Longest:
        assert isinstance(other, Longest)
        return Longest(self.operations + other.operations, self.elementary + other.elementary)

    def times(self, turns: int) -> Longest:
        """Return the count of `turns` repetitions."""
        return Longest(self.operations * turns, self.elementary * turns)


NOTHING = Longest(0, 0)


def longest(program: Program) -> Longest | None:
    """Count the operations if every loop runs as long as it can and every branch takes the longer side.

    Returns None if a loop does not count its own iterations.
    """
    return _of_region(program.body)


def turns(loop: Loop) -> int | None:
    """Return the largest number of iterations of a loop that counts by one up to a constant; None for other loops."""
    bounds = [bound for condition in _all_of(loop.condition) if (bound := _count(loop, condition)) is not None]
    return min(bounds, default=None)


def _all_of(condition: Value) -> Iterator[Value]:
    """Conditions that must all hold."""
    if condition.op == "and":
        for part in condition.args:
            yield from _all_of(part)
    else:
        yield condition


def _count(loop: Loop, condition: Value) -> int | None:
    if condition.op != "lt":
        return None
    counter, end = condition.args
    if counter not in loop.params or end.op != "const":
        return None
    k = loop.params.index(counter)
    start, following = loop.args[k], loop.following[k]
    by_one = following.op == "add" and any(
        previous is counter and step.op == "const" and step.data == 1
        for previous, step in (following.args, following.args[::-1])
    )
    if start.op != "const" or not by_one:
        return None
    return max(int(end.data) - int(start.data), 0)


def _of_region(region: Region) -> Longest | None:
    total = NOTHING
    for value in region.values:
        count = _of_value(value)
        if count is None:
            return None
        total += count
    return total


def _of_value(value: Value) -> Longest | None:
    if value.op in FREE:
        return NOTHING
    if isinstance(value, Call):
        return longest(value.program)
    if isinstance(value, Loop):
        most, head, body = turns(value), _of_region(value.head), _of_region(value.body)
        if most is None or head is None or body is None:
            return None
        # The condition is evaluated once more than the body.
        return (head + body).times(most) + head
    if isinstance(value, Branch):
        then, otherwise = _of_region(value.then), _of_region(value.otherwise)
        if then is None or otherwise is None:
            return None
        # Each count by itself: the side with more operations may have fewer elementary functions.
        return Longest(1, 0) + Longest(*map(max, then, otherwise))
    return Longest(1, int(value.op in ELEMENTARY))
