"""Which statements become one array."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence

from ..naming import identifier
from .alike import LEAST, Access, Stored, accesses
from .groups import Group, Statement
from .writer import LETTERS


class Arrays:
    """The arrays of a function.

    - `taken`: names that are not free.
    """

    def __init__(self, taken: set[str]) -> None:
        self.taken = taken
        self.stored: Stored = {}
        self.single: dict[str, Group] = {}

    def where(self, word: str) -> str:
        """How an operand is read.

        - `word`: its name before.
        """
        stored = self.stored.get(word)
        return word if stored is None else f"{stored[0]}[{stored[1]}]"

    def named(self, stem: str) -> str:
        """A name that is free, for an array.

        - `stem`: that it begins with; numbers behind it are left out.
        """
        stem = re.sub(r"_?\d+[a-z]*$", "", stem) or "v"
        stem = identifier(stem)
        name, letters = stem, iter(LETTERS)
        while name in self.taken:
            name = f"{stem}_{next(letters)}"
        self.taken.add(name)
        return name

    def _place_elements(self, statements: list[Statement]) -> None:
        """Gives the numbers that the source computes as an array their places in one."""
        arrays: defaultdict[tuple[int, str], list[Statement]] = defaultdict(list)
        for one in statements:
            if one.line.element is not None:
                arrays[(one.line.element[0], one.type)].append(one)
        for those in arrays.values():
            if len(those) >= LEAST:
                array = self.named(those[0].name)
                for one in those:
                    assert one.line.element is not None
                    self.stored[one.name] = (array, one.line.element[1])

    def grouped(self, statements: list[Statement]) -> list[Group]:
        """The groups that statements make.

        - `statements`: that follow each other.
        """
        self.single = {}
        self._place_elements(statements)
        alike: defaultdict[tuple[object, ...], list[Statement]] = defaultdict(list)
        for one in statements:
            alike[(one.line.visit, one.type, one.piece.template)].append(one)
        groups: list[Group] = []
        for (visit, _, _), lanes in alike.items():
            several = visit is not None and len(lanes) >= LEAST
            made = self._split(lanes) if several else [self._alone(one) for one in lanes]
            self._know(made)
            groups += made
        # What their operands have become is known only now.
        groups = self._again(groups, lambda one: (one.line.visit, one.type, one.piece.template))
        return self._again(groups, self._arrays_of)

    def _know(self, groups: list[Group]) -> None:
        self.single |= {group.lanes[0].name: group for group in groups if group.target is None}

    def _again(self, groups: list[Group], kind: Callable[[Statement], object]) -> list[Group]:
        """The groups, with those that stand alone tried once more.

        - `groups`: all.
        - `kind`: equal for statements that may be the turns of one loop; None for those that are not.
        """
        alike: defaultdict[object, list[Statement]] = defaultdict(list)
        for group in groups:
            if group.target is None and kind(group.lanes[0]) is not None:
                alike[kind(group.lanes[0])].append(group.lanes[0])
        for lanes in alike.values():
            if len(lanes) >= LEAST:
                made = self._split(lanes)
                if any(group.target is not None for group in made):
                    alone = {one.name for one in lanes}
                    groups = [group for group in groups if group.target is not None or group.lanes[0].name not in alone]
                    groups += made
                    self._know(made)
        return groups

    def _arrays_of(self, one: Statement) -> object:
        """Equal for statements on elements of the same arrays, whatever operation they are of."""
        if one.name not in self.stored:
            return None
        words = (self.where(word) for word in (one.name, *one.piece.operands))
        return (one.type, one.piece.template, *(word.partition("[")[0] for word in words))

    def _alone(self, one: Statement) -> Group:
        return Group([one], self.stored[one.name][0] if one.name in self.stored else "")

    def _gather(self, lanes: list[Statement]) -> None:
        """Puts numbers that stand alone into an array, where the turns of a loop would take one after the other."""
        for column in zip(*(one.piece.operands for one in lanes), strict=True):
            alone = [word for word in column if word in self.single and word not in self.stored]
            if len(set(column)) < len(column) or not alone:
                continue
            type = self.single[alone[0]].lanes[0].type
            if any(self.single[word].lanes[0].type != type for word in alone):
                continue
            places = self._places_beside(column, alone)
            if places is None:
                continue
            for word, place in zip(column, places, strict=True):
                if word in alone:
                    self.stored[word] = place
                    self.single[word].array = place[0]

    def _places_beside(self, column: Sequence[str], alone: list[str]) -> list[tuple[str, int]] | None:
        """Where the numbers of a column lie once those that stand alone lie beside the others; None if they cannot."""
        if len(alone) == len(column):
            array = self.named(column[0])
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
        """The groups that statements of one kind make: each as long as it goes, every so many of them."""
        self._gather(lanes)
        best: list[Group] = []
        for step in (1, 2, 3):
            found: list[Group] = []
            for offset in range(step):
                found += self._in_runs(lanes[offset::step])
            if not best or len(found) < len(best):
                best = found
        # The rows of a matrix lie one behind the other.
        array, start = "", 0
        for group in best:
            if group.target is not None and not group.array:
                array = group.array = array or self.named(group.lanes[0].name)
                group.target = Access(array, start, 1)
                for k, one in enumerate(group.lanes):
                    self.stored[one.name] = (array, start + k)
                start += len(group.lanes)
        return best

    def _in_runs(self, lanes: list[Statement]) -> list[Group]:
        groups = []
        k = 0
        while k < len(lanes):
            # Where the numbers go must follow a rule as well, if that is settled.
            placed = [one.name in self.stored for one in lanes[k:]]
            alike = next((n for n, one in enumerate(placed) if one != placed[0]), len(placed))
            names = [(one.name,) if placed[0] else () for one in lanes[k : k + alike]]
            rows = [(*name, *one.piece.operands) for name, one in zip(names, lanes[k : k + alike], strict=True)]
            count, at = accesses(rows, self.stored)
            if count < LEAST or (placed[0] and not at[0].step):
                groups.append(self._alone(lanes[k]))
                k += 1
                continue
            group = Group(lanes[k : k + count], at=at[1:] if placed[0] else at)
            group.target = at[0] if placed[0] else Access("", 0, 1)
            group.array = group.target.array
            groups.append(group)
            k += count
        return groups
