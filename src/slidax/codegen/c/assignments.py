"""Runs of assignments that one loop can make, and an order in which they can be made."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

from .alike import LEAST, Access, Operands, Stored, find_accesses
from .groups import Statement

Where = Callable[[str], str]
"""From an operand's name to the C text that reads it."""

ZEROS = frozenset({"0.0", "0.0f", "0", "false"})
"""Numbers whose bits are all zero."""


class AssignmentRun:
    """Assignments that one loop makes, or a single assignment.

    - `lanes`: the assignments, in order.
    - `at`: rules for target and operands; empty for a single assignment.
    - `where`: C text that reads an operand.
    """

    def __init__(self, lanes: list[Statement], at: Sequence[Access], where: Where) -> None:
        self.lanes = lanes
        self.at = list(at)
        self.reads = [{where(word) for word in lane.piece.operands} for lane in lanes]
        self.writes = [where(lane.name) for lane in lanes]

    @property
    def is_block_move(self) -> bool:
        """True if it copies a part of an array to another one, or sets it to zero."""
        return (
            bool(self.at) and self.at[0].step == 1 and self.lanes[0].piece.template == "\0" and self._has_flat_source()
        )

    def _has_flat_source(self) -> bool:
        source = self.at[1]
        if source.numbers:
            return False
        if not source.step:
            return source.text in ZEROS
        # Overlapping parts must be moved one by one.
        return source.step == 1 and (source.array != self.at[0].array or not self._overlaps())

    def _overlaps(self) -> bool:
        return any(place in read for place in self.writes for read in self.reads)


def runs_of(statements: Sequence[Statement], stored: Stored, where: Where) -> list[AssignmentRun]:
    """Return runs of assignments, in an order in which they can be made.

    A loop has only one assignment: compilers do not vectorise several.

    - `stored`: values that have become elements of arrays.
    - `where`: C text that reads an operand.
    """
    kinds: dict[object, list[Statement]] = {}
    for lane in statements:
        arrays = tuple(where(word).partition("[")[0] for word in (lane.name, *lane.piece.operands))
        kinds.setdefault((lane.piece.template, *arrays), []).append(lane)
    by_element = [sorted(those, key=lambda lane: _element(where(lane.name))) for those in kinds.values()]
    order = _order([run for those in by_element for run in _split(those, stored, where)])
    return _split(statements, stored, where) if order is None else order


def _element(word: str) -> int:
    """Index of an element in its array."""
    return int(word.partition("[")[2][:-1]) if word[-1] == "]" else 0


def _split(statements: Sequence[Statement], stored: Stored, where: Where) -> list[AssignmentRun]:
    """Runs of statements, in their order."""
    runs: list[AssignmentRun] = []
    k = 0
    while k < len(statements):
        end = k + 1
        while end < len(statements) and statements[end].piece.template == statements[k].piece.template:
            end += 1
        rows: list[Operands] = [(lane.name, *lane.piece.operands) for lane in statements[k:end]]
        count, at = find_accesses(rows, stored)
        # A table of constants is no shorter than assignments that are made once.
        if count < LEAST or not at[0].step:
            count, at = 1, []
        runs.append(AssignmentRun(list(statements[k : k + count]), at, where))
        k += count
    return runs


def _order(runs: Sequence[AssignmentRun]) -> list[AssignmentRun] | None:
    """The runs in an order that keeps each read and write in place; None if there is no such order."""
    readers: defaultdict[str, list[tuple[int, int, int]]] = defaultdict(list)
    writers: defaultdict[str, list[tuple[int, int, int]]] = defaultdict(list)
    for k, run in enumerate(runs):
        for turn, (lane, reads, written) in enumerate(zip(run.lanes, run.reads, run.writes, strict=True)):
            writers[written].append((lane.place, k, turn))
            for word in reads:
                readers[word].append((lane.place, k, turn))
    before: defaultdict[int, set[int]] = defaultdict(set)
    for word, those in writers.items():
        for place, k, turn in those:
            # An array may also be read at a computed index.
            whole = readers.get(word.partition("[")[0], ()) if word[-1] == "]" else ()
            for other, other_k, other_turn in (*readers.get(word, ()), *whole, *those):
                if k == other_k:
                    if (place < other) != (turn < other_turn):
                        return None
                elif place < other:
                    before[other_k].add(k)
                else:
                    before[k].add(other_k)
    order: list[AssignmentRun] = []
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
