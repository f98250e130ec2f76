"""Assignments: which of them are the turns of one loop, and in which order they can be made."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

from .alike import LEAST, Access, Operands, Stored, accesses
from .groups import Statement

Where = Callable[[str], str]
"""From an operand's name before to how it is read."""

ZEROS = frozenset({"0.0", "0.0f", "0", "false"})
"""Numbers whose bits are all zero."""


class Run:
    """Assignments that are the turns of one loop, or a single one.

    - `lanes`: in order.
    - `at`: where each goes in turn i, and how its operands are found; empty for a single one.
    - `where`: how operands are read.
    """

    def __init__(self, lanes: list[Statement], at: Sequence[Access], where: Where) -> None:
        self.lanes = lanes
        self.at = list(at)
        self.reads = [{where(word) for word in one.piece.operands} for one in lanes]
        self.writes = [where(one.name) for one in lanes]

    @property
    def at_once(self) -> bool:
        """Whether it moves a part of an array to another one, or makes it zero."""
        return bool(self.at) and self.at[0].step == 1 and self.lanes[0].piece.template == "\0" and self._is_flat()

    def _is_flat(self) -> bool:
        given = self.at[1]
        if given.numbers:
            return False
        if not given.step:
            return given.text in ZEROS
        # What overlaps must be moved one by one.
        return given.step == 1 and (given.array != self.at[0].array or not self._overlaps())

    def _overlaps(self) -> bool:
        return any(place in read for place in self.writes for read in self.reads)


def in_runs(statements: Sequence[Statement], stored: Stored, where: Where) -> list[Run]:
    """Runs of assignments, in an order in which they can be made.

    A loop has one assignment: of several a compiler makes no vectors.

    - `statements`: that follow each other.
    - `stored`: numbers that have become elements of arrays.
    - `where`: how operands are read.
    """
    kinds: dict[object, list[Statement]] = {}
    for one in statements:
        arrays = tuple(where(word).partition("[")[0] for word in (one.name, *one.piece.operands))
        kinds.setdefault((one.piece.template, *arrays), []).append(one)
    by_element = [sorted(those, key=lambda one: _element(where(one.name))) for those in kinds.values()]
    order = _ordered([run for those in by_element for run in _split(those, stored, where)])
    return _split(statements, stored, where) if order is None else order


def _element(word: str) -> int:
    """The number of an element, in its array."""
    return int(word.partition("[")[2][:-1]) if word[-1] == "]" else 0


def _split(statements: Sequence[Statement], stored: Stored, where: Where) -> list[Run]:
    """The runs of statements, in their order."""
    runs: list[Run] = []
    k = 0
    while k < len(statements):
        end = k + 1
        while end < len(statements) and statements[end].piece.template == statements[k].piece.template:
            end += 1
        rows: list[Operands] = [(one.name, *one.piece.operands) for one in statements[k:end]]
        count, at = accesses(rows, stored)
        # A table of numbers that are written once is no shorter than the writing.
        if count < LEAST or not at[0].step:
            count, at = 1, []
        runs.append(Run(list(statements[k : k + count]), at, where))
        k += count
    return runs


def _ordered(runs: Sequence[Run]) -> list[Run] | None:
    """The runs so that what one reads or writes of another keeps its order; None if there is no such order."""
    readers: defaultdict[str, list[tuple[int, int, int]]] = defaultdict(list)
    writers: defaultdict[str, list[tuple[int, int, int]]] = defaultdict(list)
    for k, run in enumerate(runs):
        for turn, (one, reads, written) in enumerate(zip(run.lanes, run.reads, run.writes, strict=True)):
            writers[written].append((one.place, k, turn))
            for word in reads:
                readers[word].append((one.place, k, turn))
    before: defaultdict[int, set[int]] = defaultdict(set)
    for word, those in writers.items():
        for place, k, turn in those:
            # An array may also be read at an index that is computed.
            whole = readers.get(word.partition("[")[0], ()) if word[-1] == "]" else ()
            for other, other_k, other_turn in (*readers.get(word, ()), *whole, *those):
                if k == other_k:
                    if (place < other) != (turn < other_turn):
                        return None
                elif place < other:
                    before[other_k].add(k)
                else:
                    before[k].add(other_k)
    order: list[Run] = []
    left = list(range(len(runs)))
    done: set[int] = set()
    while left:
        ready = [k for k in left if before[k] <= done][:1]
        if not ready:
            return None
        order.append(runs[ready[0]])
        done.add(ready[0])
        left.remove(ready[0])
    return order
