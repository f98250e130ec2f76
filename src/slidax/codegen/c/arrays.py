"""Replace single variables and statements by arrays and loops.

Statements with equal expressions, except for the operands, can become a loop. A lane is one of these statements, which
is one iteration of the loop.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence

from ..naming.names import identifier
from .similar import LEAST, Access, Group, Operands, Statement, Stored, find_accesses
from .writer import LETTERS


class Arrays:
    """Arrays that replace single variables of a C function.

    - `taken`: names in use.
    - `stored`: for each variable that has become an array element, by its name, the array and the index.
    - `single`: the groups that are a single statement, by the name of the variable that it declares.
    """

    def __init__(self, taken: set[str]) -> None:
        self.taken = taken
        self.stored: Stored = {}
        self.single: dict[str, Group] = {}

    def read(self, word: str) -> str:
        """Return the C text that reads an operand: its array element, or its own name if it has none."""
        stored = self.stored.get(word)
        return word if stored is None else f"{stored[0]}[{stored[1]}]"

    def new_name(self, stem: str) -> str:
        """Return an unused name for an array, from the name `stem` without a number at its end."""
        stem = re.sub(r"_?\d+[a-z]*$", "", stem) or "v"
        stem = identifier(stem)
        name, letters = stem, iter(LETTERS)
        while name in self.taken:
            name = f"{stem}_{next(letters)}"
        self.taken.add(name)
        return name

    def _place_elements(self, statements: list[Statement]) -> None:
        """Store values that the source computes as one array in a C array."""
        arrays: defaultdict[tuple[int, str], list[Statement]] = defaultdict(list)
        for statement in statements:
            if statement.line.element is not None:
                arrays[(statement.line.element[0], statement.type)].append(statement)
        for those in arrays.values():
            if len(those) >= LEAST:
                array = self.new_name(those[0].name)
                for statement in those:
                    assert statement.line.element is not None
                    self.stored[statement.name] = (array, statement.line.element[1])

    def groups_of(self, statements: list[Statement]) -> list[Group]:
        """Group the statements of a function; return the groups. One loop computes a group with several statements."""
        self.single = {}
        self._place_elements(statements)
        alike: defaultdict[tuple[object, ...], list[Statement]] = defaultdict(list)
        for statement in statements:
            alike[(statement.line.visit, statement.type, statement.piece.template)].append(statement)
        groups: list[Group] = []
        for (visit, _, _), lanes in alike.items():
            several = visit is not None and len(lanes) >= LEAST
            parts = self._split(lanes) if several else [self._single_group(lane) for lane in lanes]
            self._add_singles(parts)
            groups += parts
        # Only now are the arrays known that contain the operands of single statements.
        groups = self._regroup(groups, lambda lane: (lane.line.visit, lane.type, lane.piece.template))
        return self._regroup(groups, self._arrays_of)

    def _add_singles(self, groups: list[Group]) -> None:
        self.single |= {group.lanes[0].name: group for group in groups if group.target is None}

    def _regroup(self, groups: list[Group], kind: Callable[[Statement], object]) -> list[Group]:
        """Group single statements again; statements with an equal `kind` other than None may share a loop."""
        alike: defaultdict[object, list[Statement]] = defaultdict(list)
        for group in groups:
            if group.target is None and kind(group.lanes[0]) is not None:
                alike[kind(group.lanes[0])].append(group.lanes[0])
        for lanes in alike.values():
            if len(lanes) >= LEAST:
                parts = self._split(lanes)
                if any(group.target is not None for group in parts):
                    alone = {lane.name for lane in lanes}
                    groups = [group for group in groups if group.target is not None or group.lanes[0].name not in alone]
                    groups += parts
                    self._add_singles(parts)
        return groups

    def _arrays_of(self, statement: Statement) -> object:
        """Return a key that is equal for statements on elements of the same arrays."""
        if statement.name not in self.stored:
            return None
        words = (self.read(word) for word in (statement.name, *statement.piece.operands))
        return (statement.type, statement.piece.template, *(word.partition("[")[0] for word in words))

    def _single_group(self, lane: Statement) -> Group:
        return Group([lane], self.stored[lane.name][0] if lane.name in self.stored else "")

    def _gather(self, lanes: list[Statement]) -> None:
        """Store single values in an array if a loop would read a different one in each iteration."""
        for column in zip(*(lane.piece.operands for lane in lanes), strict=True):
            alone = [word for word in column if word in self.single and word not in self.stored]
            if len(set(column)) < len(column) or not alone:
                continue
            type = self.single[alone[0]].lanes[0].type
            if any(self.single[word].lanes[0].type != type for word in alone):
                continue
            elements = self._free_elements(column, alone)
            if elements is None:
                continue
            for word, element in zip(column, elements, strict=True):
                if word in alone:
                    self.stored[word] = element
                    self.single[word].array = element[0]

    def _free_elements(self, column: Sequence[str], alone: list[str]) -> list[tuple[str, int]] | None:
        """Return an array element for each value of a column; None if the elements of its single values are not free.

        - `column`: the operands that a loop reads, one per iteration.
        - `alone`: the operands that are single values.
        """
        if len(alone) == len(column):
            array = self.new_name(column[0])
            return [(array, k) for k in range(len(column))]
        known = [(k, self.stored[word]) for k, word in enumerate(column) if word in self.stored]
        if len(known) < LEAST or len(known) + len(alone) < len(column) or len({array for _, (array, _) in known}) > 1:
            return None
        (k, (array, at)), (other, (_, end)) = known[0], known[-1]
        step = (end - at) // (other - k)
        elements = [(array, at + (n - k) * step) for n in range(len(column))]
        taken = set(self.stored.values())
        if any(index < 0 for _, index in elements) or any(elements[n] != element for n, element in known):
            return None
        is_taken = any(element in taken for n, element in enumerate(elements) if column[n] in alone)
        return None if is_taken else elements

    def _split(self, lanes: list[Statement]) -> list[Group]:
        """Split statements of one kind into the fewest groups, each of all, every second or every third statement."""
        self._gather(lanes)
        best: list[Group] = []
        for step in (1, 2, 3):
            groups: list[Group] = []
            for offset in range(step):
                groups += self._in_runs(lanes[offset::step])
            if not best or len(groups) < len(best):
                best = groups
        # The rows of a matrix are contiguous in its array.
        array, start = "", 0
        for group in best:
            if group.target is not None and not group.array:
                array = group.array = array or self.new_name(group.lanes[0].name)
                group.target = Access(array, start, 1)
                for k, lane in enumerate(group.lanes):
                    self.stored[lane.name] = (array, start + k)
                start += len(group.lanes)
        return best

    def _in_runs(self, lanes: list[Statement]) -> list[Group]:
        groups = []
        k = 0
        while k < len(lanes):
            # Results that are already stored in an array must follow a rule as well.
            placed = [lane.name in self.stored for lane in lanes[k:]]
            alike = next((n for n, known in enumerate(placed) if known != placed[0]), len(placed))
            names = [(lane.name,) if placed[0] else () for lane in lanes[k : k + alike]]
            rows = [(*name, *lane.piece.operands) for name, lane in zip(names, lanes[k : k + alike], strict=True)]
            count, at = find_accesses(rows, self.stored)
            if count < LEAST or (placed[0] and not at[0].step):
                groups.append(self._single_group(lanes[k]))
                k += 1
                continue
            group = Group(lanes[k : k + count], at=at[1:] if placed[0] else at)
            group.target = at[0] if placed[0] else Access("", 0, 1)
            group.array = group.target.array
            groups.append(group)
            k += count
        return groups


Where = Callable[[str], str]
"""Map an operand's name to the C text that reads it."""

ZEROS = frozenset({"0.0", "0.0f", "0", "false"})
"""Numbers whose bits are all zero."""


class AssignmentRun:
    """Assignments that one loop performs, or a single assignment.

    - `lanes`: the assignments, in order; one per iteration of the loop.
    - `at`: rules for the array elements that an iteration accesses: target, then operands; empty for a single
      assignment.
    - `where`: function from an operand to the C text that reads it.
    """

    def __init__(self, lanes: list[Statement], at: Sequence[Access], where: Where) -> None:
        self.lanes = lanes
        self.at = list(at)
        self.reads = [{where(word) for word in lane.piece.operands} for lane in lanes]
        self.writes = [where(lane.name) for lane in lanes]

    @property
    def is_block_move(self) -> bool:
        """True if the run copies consecutive elements of an array to another one, or sets them to zero."""
        if not self.at or self.at[0].step != 1 or self.lanes[0].piece.template != "\0":
            return False
        target, source = self.at
        if source.step == 1 and source.array == target.array:
            # Overlapping parts must be moved one by one.
            return not any(written in read for written in self.writes for read in self.reads)
        return source.step == 1 or source.text in ZEROS


def runs_of(statements: Sequence[Statement], stored: Stored, where: Where) -> list[AssignmentRun]:
    """Split assignments into runs, each for one loop; return the runs in an order that leaves all results unchanged.

    A run has assignments that are equal but for array indices with constant steps, or a single other assignment. The
    body of a loop is a single assignment, since compilers do not vectorise several.

    - `stored`: for each variable that has become an array element, by its name, the array and the index.
    - `where`: function from an operand to the C text that reads it.
    """
    kinds: dict[object, list[Statement]] = {}
    for lane in statements:
        arrays = tuple(where(word).partition("[")[0] for word in (lane.name, *lane.piece.operands))
        kinds.setdefault((lane.piece.template, *arrays), []).append(lane)
    by_element = [sorted(those, key=lambda lane: _element(where(lane.name))) for those in kinds.values()]
    order = _order([run for those in by_element for run in _split(those, stored, where)])
    return _split(statements, stored, where) if order is None else order


def _element(word: str) -> int:
    """Return the index of an element in its array."""
    return int(word.partition("[")[2][:-1]) if word[-1] == "]" else 0


def _split(statements: Sequence[Statement], stored: Stored, where: Where) -> list[AssignmentRun]:
    """Return runs of statements, in their order."""
    runs: list[AssignmentRun] = []
    k = 0
    while k < len(statements):
        end = k + 1
        while end < len(statements) and statements[end].piece.template == statements[k].piece.template:
            end += 1
        rows: list[Operands] = [(lane.name, *lane.piece.operands) for lane in statements[k:end]]
        count, at = find_accesses(rows, stored)
        # A table of constants is not shorter than assignments that are executed once.
        if count < LEAST or not at[0].step:
            count, at = 1, []
        runs.append(AssignmentRun(list(statements[k : k + count]), at, where))
        k += count
    return runs


def _order(runs: Sequence[AssignmentRun]) -> list[AssignmentRun] | None:
    """Return the runs in an order that preserves the sequence of reads and writes; None if there is no such order."""
    readers: defaultdict[str, list[tuple[int, int, int]]] = defaultdict(list)
    writers: defaultdict[str, list[tuple[int, int, int]]] = defaultdict(list)
    for k, run in enumerate(runs):
        for i, (lane, reads, written) in enumerate(zip(run.lanes, run.reads, run.writes, strict=True)):
            writers[written].append((lane.index, k, i))
            for word in reads:
                readers[word].append((lane.index, k, i))
    before: defaultdict[int, set[int]] = defaultdict(set)
    for word, those in writers.items():
        for index, k, i in those:
            # An array may also be read at a computed index.
            array_readers = readers.get(word.partition("[")[0], ()) if word[-1] == "]" else ()
            for other, other_k, other_i in (*readers.get(word, ()), *array_readers, *those):
                if k == other_k:
                    if (index < other) != (i < other_i):
                        return None
                elif index < other:
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
