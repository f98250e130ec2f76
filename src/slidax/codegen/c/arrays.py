"""Choose the statements that become one array."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence

from ..naming import identifier
from .alike import LEAST, Access, Stored, find_accesses
from .groups import Group, Statement
from .writer import LETTERS


class Arrays:
    """Arrays of a function.

    - `taken`: names in use.
    """

    def __init__(self, taken: set[str]) -> None:
        self.taken = taken
        self.stored: Stored = {}
        self.single: dict[str, Group] = {}

    def read(self, word: str) -> str:
        """Return the C text that reads an operand."""
        stored = self.stored.get(word)
        return word if stored is None else f"{stored[0]}[{stored[1]}]"

    def new_name(self, stem: str) -> str:
        """Return a free name for an array, from a stem without its trailing number."""
        stem = re.sub(r"_?\d+[a-z]*$", "", stem) or "v"
        stem = identifier(stem)
        name, letters = stem, iter(LETTERS)
        while name in self.taken:
            name = f"{stem}_{next(letters)}"
        self.taken.add(name)
        return name

    def _place_elements(self, statements: list[Statement]) -> None:
        """Place values that the source computes as an array in one array."""
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
        """Return the groups of successive statements."""
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
        # Only now are the arrays of their operands known.
        groups = self._regroup(groups, lambda lane: (lane.line.visit, lane.type, lane.piece.template))
        return self._regroup(groups, self._arrays_of)

    def _add_singles(self, groups: list[Group]) -> None:
        self.single |= {group.lanes[0].name: group for group in groups if group.target is None}

    def _regroup(self, groups: list[Group], kind: Callable[[Statement], object]) -> list[Group]:
        """Group single statements again; one loop may compute statements with one `kind` other than None."""
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
        """Equal for statements on elements of the same arrays, from any operation of the source."""
        if statement.name not in self.stored:
            return None
        words = (self.read(word) for word in (statement.name, *statement.piece.operands))
        return (statement.type, statement.piece.template, *(word.partition("[")[0] for word in words))

    def _single_group(self, lane: Statement) -> Group:
        return Group([lane], self.stored[lane.name][0] if lane.name in self.stored else "")

    def _gather(self, lanes: list[Statement]) -> None:
        """Place single values in an array, where a loop would read one in each iteration."""
        for column in zip(*(lane.piece.operands for lane in lanes), strict=True):
            alone = [word for word in column if word in self.single and word not in self.stored]
            if len(set(column)) < len(column) or not alone:
                continue
            type = self.single[alone[0]].lanes[0].type
            if any(self.single[word].lanes[0].type != type for word in alone):
                continue
            places = self._free_places(column, alone)
            if places is None:
                continue
            for word, place in zip(column, places, strict=True):
                if word in alone:
                    self.stored[word] = place
                    self.single[word].array = place[0]

    def _free_places(self, column: Sequence[str], alone: list[str]) -> list[tuple[str, int]] | None:
        """Places for the single values of a column next to its other values; None if there are none."""
        if len(alone) == len(column):
            array = self.new_name(column[0])
            return [(array, k) for k in range(len(column))]
        known = [(k, self.stored[word]) for k, word in enumerate(column) if word in self.stored]
        if len(known) < LEAST or len(known) + len(alone) < len(column) or len({array for _, (array, _) in known}) > 1:
            return None
        (k, (array, at)), (other, (_, end)) = known[0], known[-1]
        step = (end - at) // (other - k)
        places = [(array, at + (n - k) * step) for n in range(len(column))]
        taken = set(self.stored.values())
        if any(place[1] < 0 for place in places) or any(places[n] != place for n, place in known):
            return None
        return places if not any(place in taken for n, place in enumerate(places) if column[n] in alone) else None

    def _split(self, lanes: list[Statement]) -> list[Group]:
        """Split statements of one kind into the fewest groups, of every first, second or third statement."""
        self._gather(lanes)
        best: list[Group] = []
        for step in (1, 2, 3):
            groups: list[Group] = []
            for offset in range(step):
                groups += self._in_runs(lanes[offset::step])
            if not best or len(groups) < len(best):
                best = groups
        # The rows of a matrix follow each other in its array.
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
            # Places that are chosen already must follow a rule as well.
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
