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
    def turns(self) -> int:
        """How many turns its loop has; 1 for a single assignment, and for what is moved or cleared at once."""
        return 1 if not self.at or self.at_once else len(self.lanes)

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

    def turns_with(self, other: Run) -> bool:
        """Whether a loop that makes all of the other run before this one may make them turn by turn instead.

        - `other`: of as many turns.
        """
        for i, (read, written) in enumerate(zip(self.reads, self.writes, strict=True)):
            for reads, writes in zip(other.reads[i + 1 :], other.writes[i + 1 :], strict=True):
                if written in reads or writes in read or written == writes:
                    return False
        return True


def in_runs(statements: Sequence[Statement], stored: Stored, where: Where) -> list[list[Run]]:
    """Runs of assignments in an order in which they can be made; those in one list are made in one loop.

    - `statements`: that follow each other.
    - `stored`: numbers that have become elements of arrays.
    - `where`: how operands are read.
    """
    kinds: dict[object, list[Statement]] = {}
    for one in statements:
        arrays = tuple(where(word).partition("[")[0] for word in (one.name, *one.piece.operands))
        kinds.setdefault((one.piece.template, *arrays), []).append(one)
    runs = [run for those in kinds.values() for run in _split(those, stored, where)]
    order = _ordered(runs)
    return _together(_split(statements, stored, where) if order is None else order)


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
    readers: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    writers: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    for k, run in enumerate(runs):
        for one, reads, written in zip(run.lanes, run.reads, run.writes, strict=True):
            writers[written].append((one.place, k))
            for word in reads:
                readers[word].append((one.place, k))
    before: defaultdict[int, set[int]] = defaultdict(set)
    for word, those in writers.items():
        for place, k in those:
            # An array may also be read at an index that is computed.
            whole = readers.get(word.partition("[")[0], ()) if word[-1] == "]" else ()
            for other, other_k in (*readers.get(word, ()), *whole, *those):
                if (other, other_k) == (place, k):
                    continue
                sooner, later = (k, other_k) if place < other else (other_k, k)
                if sooner != later:
                    before[later].add(sooner)
    order: list[Run] = []
    left = list(range(len(runs)))
    done: set[int] = set()
    while left:
        ready = [k for k in left if before[k] <= done]
        if not ready:
            return None
        turns = order[-1].turns if order else 1
        k = min(ready, key=lambda k: (runs[k].turns != turns, k))
        order.append(runs[k])
        done.add(k)
        left.remove(k)
    return order


def _together(runs: Sequence[Run]) -> list[list[Run]]:
    """The runs, with those in one list that one loop can make."""
    loops: list[list[Run]] = []
    for run in runs:
        last = loops[-1] if loops else []
        if last and run.turns == last[0].turns > 1 and all(run.turns_with(other) for other in last):
            last.append(run)
        else:
            loops.append([run])
    return loops
