"""Superword-level parallelism: operations that are alike for all joints are found and done at once.

From what lies side by side, the elements of an input or of what a loop carries, the search goes forward: where
operations of one kind take such elements one after the other, and beside them the same numbers, their results lie side
by side too. Each operation keeps its own rounding, so that nothing changes in the numbers.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product

from slidax.codegen.ir import BLOCKS, Branch, Loop, Program, Region, Value, regions

from .order import awaited, waiting

Members = tuple[Value, ...]

ALIKE = frozenset(
    (
        *("add", "sub", "mul", "div", "neg", "abs", "min", "max", "fma", "sqrt", "floor", "ceil", "rint"),
        *("eq", "ne", "lt", "le", "gt", "ge", "isfinite", "select", "convert", "bitcast"),
        *("and", "or", "xor", "not", "shl", "shr", "sar"),
    )
)
"""Operations that processors have for vectors."""

COMMUTATIVE = frozenset({"add", "mul", "min", "max", "and", "or", "xor", "eq", "ne"})

WIDEST = 8
"""Longest vector that is looked for."""


class Bundles:
    """Which values lie side by side.

    - `program`: is searched, and stays as it is.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.place: dict[Value, tuple[Members, int]] = {}
        self.made: dict[Members, None] = {}  # those that are computed as one; of the others the elements are just known
        self.slots: dict[Members, list[Members]] = {}  # of each that is computed, by argument, what its members take
        self._table: dict[tuple[object, ...], Value] = {}
        self._users: defaultdict[Value, list[Value]] = defaultdict(list)
        self._row_of = {value: row for row in _rows_of_outputs(program) for value in row}
        self._index(program.body)
        self._inputs()
        self._search(program.body)
        self._make_possible(program.body)

    def dissolve(self, members: Members) -> None:
        """Takes a bundle apart.

        - `members`: of the bundle.
        """
        self.made.pop(members, None)
        for value in members:
            if self.place.get(value, (None,))[0] == members:
                del self.place[value]

    # ---- search -----------------------------------------------------------------------------------------------------

    def _index(self, region: Region) -> None:
        for value in region.values:
            self._table[_key(value, [arg.number for arg in value.args])] = value
            if value.op in ALIKE:
                for arg in value.args:
                    self._users[arg].append(value)
            elif value.op in BLOCKS:
                for inner in regions(value):
                    self._index(inner)

    def _put(self, members: Members, *, made: bool = True) -> None:
        for k, value in enumerate(members):
            self.place[value] = members, k
        if made:
            self.made[members] = None

    def _inputs(self) -> None:
        elements: dict[tuple[int, int], Value] = {
            value.data: value for value in self.program.body.values if value.op == "input"
        }
        for which, entry in enumerate(self.program.inputs):
            for row in _rows(range(entry.size), entry.shape):
                found = [elements.get((which, k)) for k in row]
                members = tuple(value for value in found if value is not None)
                if len(members) == len(row):
                    self._put(members)

    def _search(self, region: Region) -> None:
        for value in region.values:
            if isinstance(value, Loop):
                self._search_loop(value)
            elif isinstance(value, Branch):
                self._search(value.then)
                self._search(value.otherwise)
                self._extend(value, made=False)
            elif value.op in ALIKE:
                self._extend(value, made=True)
            elif value.op == "result" and isinstance(value.args[0], Branch):
                self._extend(value, made=False)

    def _search_loop(self, loop: Loop) -> None:
        left = {value.data: value for value in loop.region.values if value.op == "result" and value.args[0] is loop}
        k = 1  # the first may be counted by, and stays alone
        while k < len(loop.params):
            size = self._carried_with(loop, k, left)
            if size > 1:
                self._put(loop.params[k : k + size])
                members = tuple(left[i] for i in range(k, k + size) if i in left)
                if len(members) == size:
                    self._put(members, made=False)
            k += size
        self._search(loop.head)
        self._search(loop.body)

    def _carried_with(self, loop: Loop, k: int, left: Mapping[int, Value]) -> int:
        """How many numbers, from the k-th on, a loop carries side by side: a row when it ends, or when it begins."""
        row = self._row_of.get(left[k]) if k in left else None
        if row is not None and [value.data for value in row] == list(range(k, k + len(row))):
            return len(row)
        first = self.place.get(loop.args[k])
        if first is not None and loop.args[k : k + len(first[0])] == first[0]:
            return len(first[0])
        return 1

    def _extend(self, value: Value, *, made: bool) -> None:
        """Looks for those that are to their arguments' neighbours what a value is to its arguments."""
        if value in self.place:
            return
        places = [self.place.get(arg) for arg in value.args]
        moving = [k for k, place in enumerate(places) if place is not None and place[1] + 1 < len(place[0])]
        # Rather all arguments move on together; some may stand still.
        for choice in sorted(product((True, False), repeat=len(moving)), key=lambda c: -sum(c)):
            steps = [k for k, chosen in zip(moving, choice, strict=True) if chosen]
            if steps:
                slots = self._beside(value, steps)
                members = self._taking(value, slots)
                if len(members) > 1:
                    self._put(members, made=made)
                    self.slots[members] = slots
                    return
        if made and moving:
            self._extend_by_one(value, moving[0])

    def _extend_by_one(self, value: Value, k: int) -> None:
        """The same where only the k-th argument has neighbours, if there is no doubt who belongs together."""
        those, first = self.place[value.args[k]]
        members: list[Value] = []
        slots: list[Members] = []
        for arg in those[first:]:
            users = [user for user in self._users[arg] if user not in self.place and _is_like(user, value)]
            alike = [user for user in users if _rest(user, arg) == _rest(value, value.args[k])]
            if len(alike) != 1 or alike[0] in members:
                return
            (user,) = alike
            members.append(user)
            at = user.args.index(arg)
            if at != k:
                # Only of sums and products may arguments change places.
                if value.op not in COMMUTATIVE:
                    return
                slots.append(user.args[::-1])
            else:
                slots.append(user.args)
        if members[0] is not value:
            return
        columns = list(zip(*slots, strict=True))
        self._put(tuple(members))
        self.slots[tuple(members)] = columns
        for column in columns:
            if len(set(column)) == len(column) and not any(arg in self.place for arg in column):
                self._put(column, made=False)

    def _beside(self, value: Value, steps: Sequence[int]) -> list[Members]:
        """By argument, what a value takes and what those beside it would."""
        places = {k: self.place[value.args[k]] for k in steps}
        size = min(len(those) - first for those, first in places.values())
        slots = [(arg,) * size for arg in value.args]
        for k, (those, first) in places.items():
            slots[k] = those[first : first + size]
        return slots

    def _taking(self, value: Value, slots: Sequence[Members]) -> Members:
        """Those that take the members of the slots; none if one is missing."""
        members = [value]
        for args in list(zip(*slots, strict=True))[1:]:
            other = self._table.get(_key(value, [arg.number for arg in args]))
            if other is None or other in self.place or other in members:
                return ()
            members.append(other)
        return tuple(members)

    # ---- what can be ------------------------------------------------------------------------------------------------

    def _make_possible(self, region: Region) -> None:
        """Goes through all operations, and takes a bundle apart where none of the rest can be computed as a whole."""
        users = waiting(region.values)
        missing = awaited(users)
        bundles = [members for members in self.made if members[0] in missing]
        unfit = {members: sum(missing[value] > 0 for value in members) for members in bundles}
        ready = [value for value in missing if not self.is_made(value) and not missing[value]]
        ready += [value for members in bundles if not unfit[members] for value in members]
        while True:
            # The list grows while it is gone through.
            for value in ready:
                for user in users[value]:
                    missing[user] -= 1
                    if missing[user]:
                        continue
                    if not self.is_made(user):
                        ready.append(user)
                        continue
                    members = self.place[user][0]
                    unfit[members] -= 1
                    if not unfit[members]:
                        ready += members
            stuck = next((those for those in bundles if 0 < unfit[those] < len(those) and those in self.made), None)
            if stuck is None:
                break
            self.dissolve(stuck)
            ready = [value for value in stuck if not missing[value]]
        for value in region.values:
            if value.op in BLOCKS:
                for inner in regions(value):
                    self._make_possible(inner)

    def is_made(self, value: Value) -> bool:
        """Whether a value is computed together with others."""
        place = self.place.get(value)
        return place is not None and place[0] in self.made


def _key(value: Value, numbers: Sequence[int]) -> tuple[object, ...]:
    data: object = value.data
    if isinstance(value, Branch):
        data = (len(value.then.values), len(value.otherwise.values), len(value.yes))
    ordered = sorted(numbers) if value.op in COMMUTATIVE else numbers
    return (value.op, value.type, data, value.region, *ordered)


def _is_like(value: Value, other: Value) -> bool:
    return (
        value.op == other.op
        and value.region is other.region
        and value.type == other.type
        and bool(value.data == other.data)
    )


def _rest(value: Value, arg: Value) -> list[str]:
    """Of what types all is that a value takes beside one of its arguments."""
    return sorted(other.type for other in value.args if other is not arg)


def _rows(numbers: Sequence[int], shape: tuple[int, ...]) -> Iterator[Sequence[int]]:
    """The rows of an array, if they are vectors that are worth it."""
    if shape and 2 <= shape[-1] <= WIDEST:
        for first in range(0, len(numbers), shape[-1]):
            yield numbers[first : first + shape[-1]]


def _rows_of_outputs(program: Program) -> Iterable[Members]:
    """Rows of outputs that loops leave behind, each value once."""
    seen: set[Value] = set()
    for output in program.outputs:
        values = output.values or ()
        for row in _rows(range(len(values)), output.shape):
            members = tuple(values[k] for k in row)
            if _left_by_one_loop(members) and not seen & set(members):
                seen |= set(members)
                yield members


def _left_by_one_loop(values: Members) -> bool:
    first = values[0]
    return (
        first.type != "b1"
        and all(value.op == "result" and value.args[0] is first.args[0] for value in values)
        and isinstance(first.args[0], Loop)
    )
