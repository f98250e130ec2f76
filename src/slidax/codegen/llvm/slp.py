"""Superword-level parallelism: similar scalar operations become vector operations if a cost model predicts a gain."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product

from ..builder import COMMUTATIVE
from ..ir import BLOCKS, Branch, Loop, Program, Region, Value, regions, uses
from .order import dependants, dependency_counts

Members = tuple[Value, ...]

VECTOR_OPERATIONS = frozenset(
    (
        *("add", "sub", "mul", "div", "neg", "abs", "min", "max", "fma", "sqrt", "floor", "ceil", "rint"),
        *("eq", "ne", "lt", "le", "gt", "ge", "isfinite", "select", "convert", "bitcast"),
        *("and", "or", "xor", "not", "shl", "shr", "sar"),
    )
)
"""Operations with vector instructions."""


LARGEST_WIDTH = 8
"""Largest number of lanes of a vector."""


class Bundles:
    """Search for bundles in a program, which is not changed. A bundle is a tuple of scalars that can become a vector.

    A bundle's k-th slot is the tuple of the k-th arguments of its members. A member's lane is its index in the bundle.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.lane_of: dict[Value, tuple[Members, int]] = {}
        self.vectors: dict[Members, None] = {}  # bundles computed as one vector; the others are only contiguous
        self.slots: dict[Members, list[Members]] = {}  # the arguments of each vector's members, by argument
        self._table: dict[tuple[object, ...], Value] = {}
        self._users: defaultdict[Value, list[Value]] = defaultdict(list)
        self._row_of = {value: row for row in _rows_of_outputs(program) for value in row}
        self._index(program.body)
        self._inputs()
        self._search(program.body)
        self._dissolve_cycles(program.body)

    def dissolve(self, members: Members) -> None:
        """Remove a bundle, so that its values are computed as scalars."""
        self.vectors.pop(members, None)
        for value in members:
            if self.lane_of.get(value, (None,))[0] == members:
                del self.lane_of[value]

    # ---- search -----------------------------------------------------------------------------------------------------

    def _index(self, region: Region) -> None:
        for value in region.values:
            self._table[_key(value, [arg.number for arg in value.args])] = value
            if value.op in VECTOR_OPERATIONS:
                for arg in value.args:
                    self._users[arg].append(value)
            elif value.op in BLOCKS:
                for inner in regions(value):
                    self._index(inner)

    def _put(self, members: Members, *, computed: bool = True) -> None:
        for k, value in enumerate(members):
            self.lane_of[value] = members, k
        if computed:
            self.vectors[members] = None

    def _inputs(self) -> None:
        elements: dict[tuple[int, int], Value] = {
            value.data: value for value in self.program.body.values if value.op == "input"
        }
        for which, entry in enumerate(self.program.inputs):
            for row in _rows(range(entry.size), entry.shape):
                members = tuple(elements[which, k] for k in row if (which, k) in elements)
                if len(members) == len(row):
                    self._put(members)

    def _search(self, region: Region) -> None:
        for value in region.values:
            if isinstance(value, Loop):
                self._search_loop(value)
            elif isinstance(value, Branch):
                self._search(value.then)
                self._search(value.otherwise)
                self._extend(value, computed=False)
            elif value.op in VECTOR_OPERATIONS:
                self._extend(value, computed=True)
            elif value.op == "result" and isinstance(value.args[0], Branch):
                self._extend(value, computed=False)

    def _search_loop(self, loop: Loop) -> None:
        left = {value.data: value for value in loop.region.values if value.op == "result" and value.args[0] is loop}
        k = 1  # the first may be the loop's counter, and stays a scalar
        while k < len(loop.params):
            size = self._carried_with(loop, k, left)
            if size > 1:
                self._put(loop.params[k : k + size])
                members = tuple(left[i] for i in range(k, k + size) if i in left)
                if len(members) == size:
                    self._put(members, computed=False)
            k += size
        self._search(loop.head)
        self._search(loop.body)

    def _carried_with(self, loop: Loop, k: int, left: Mapping[int, Value]) -> int:
        """Return the number of carried values, from the k-th on, that form an output's row or an earlier bundle."""
        row = self._row_of.get(left[k]) if k in left else None
        if row is not None and [value.data for value in row] == list(range(k, k + len(row))):
            return len(row)
        first = self.lane_of.get(loop.args[k])
        if first is not None and loop.args[k : k + len(first[0])] == first[0]:
            return len(first[0])
        return 1

    def _extend(self, value: Value, *, computed: bool) -> None:
        """Search for operations like `value` on the next lanes of its arguments' bundles; make them a bundle."""
        if value in self.lane_of:
            return
        places = [self.lane_of.get(arg) for arg in value.args]
        moving = [k for k, place in enumerate(places) if place is not None and place[1] + 1 < len(place[0])]
        # Prefer that all arguments advance together; some may stay the same.
        for choice in sorted(product((True, False), repeat=len(moving)), key=lambda c: -sum(c)):
            steps = [k for k, chosen in zip(moving, choice, strict=True) if chosen]
            if steps:
                slots = self._neighbours(value, steps)
                members = self._operations_on(value, slots)
                if len(members) > 1:
                    self._put(members, computed=computed)
                    self.slots[members] = slots
                    return
        if computed and moving:
            self._extend_by_users(value, moving[0])

    def _extend_by_users(self, value: Value, k: int) -> None:
        """Search for similar operations on the neighbours of the k-th argument, if each has only one such user."""
        bundle, first = self.lane_of[value.args[k]]
        members: list[Value] = []
        slots: list[Members] = []
        for arg in bundle[first:]:
            users = [user for user in self._users[arg] if user not in self.lane_of and _is_like(user, value)]
            alike = [user for user in users if _rest(user, arg) == _rest(value, value.args[k])]
            if len(alike) != 1 or alike[0] in members:
                return
            (user,) = alike
            members.append(user)
            at = user.args.index(arg)
            if at != k:
                # Only commutative operations may swap their arguments.
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
            if len(set(column)) == len(column) and not any(arg in self.lane_of for arg in column):
                self._put(column, computed=False)

    def _neighbours(self, value: Value, steps: Sequence[int]) -> list[Members]:
        """Return one slot per argument: the argument and its neighbours if it is in `steps`, else its repetitions."""
        places = {k: self.lane_of[value.args[k]] for k in steps}
        size = min(len(bundle) - first for bundle, first in places.values())
        slots = [(arg,) * size for arg in value.args]
        for k, (bundle, first) in places.items():
            slots[k] = bundle[first : first + size]
        return slots

    def _operations_on(self, value: Value, slots: Sequence[Members]) -> Members:
        """Return the operations like `value` on the members of the slots; empty if an operation is missing."""
        members = [value]
        for args in list(zip(*slots, strict=True))[1:]:
            other = self._table.get(_key(value, [arg.number for arg in args]))
            if other is None or other in self.lane_of or other in members:
                return ()
            members.append(other)
        return tuple(members)

    # ---- cycles -----------------------------------------------------------------------------------------------------

    def _dissolve_cycles(self, region: Region) -> None:
        """Dissolve bundles that depend on each other or on themselves, until all operations can be ordered."""
        users = dependants(region.values)
        missing = dependency_counts(users)
        bundles = [members for members in self.vectors if members[0] in missing]
        unfit = {members: sum(missing[value] > 0 for value in members) for members in bundles}
        ready = [value for value in missing if not self.is_vectorised(value) and not missing[value]]
        ready += [value for members in bundles if not unfit[members] for value in members]
        while True:
            # The list grows during the iteration.
            for value in ready:
                for user in users[value]:
                    missing[user] -= 1
                    if missing[user]:
                        continue
                    if not self.is_vectorised(user):
                        ready.append(user)
                        continue
                    members = self.lane_of[user][0]
                    unfit[members] -= 1
                    if not unfit[members]:
                        ready += members
            stuck = next((b for b in bundles if 0 < unfit[b] < len(b) and b in self.vectors), None)
            if stuck is None:
                break
            self.dissolve(stuck)
            ready = [value for value in stuck if not missing[value]]
        for value in region.values:
            if value.op in BLOCKS:
                for inner in regions(value):
                    self._dissolve_cycles(inner)

    def is_vectorised(self, value: Value) -> bool:
        """True if a value is computed as a vector's lane."""
        place = self.lane_of.get(value)
        return place is not None and place[0] in self.vectors


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
    """Return the sorted types of a value's arguments other than `arg`."""
    return sorted(other.type for other in value.args if other is not arg)


def _rows(numbers: Sequence[int], shape: tuple[int, ...]) -> Iterator[Sequence[int]]:
    """Yield the rows of an array, if their length fits a vector."""
    if shape and 2 <= shape[-1] <= LARGEST_WIDTH:
        for first in range(0, len(numbers), shape[-1]):
            yield numbers[first : first + shape[-1]]


def _rows_of_outputs(program: Program) -> Iterable[Members]:
    """Yield the rows of outputs that are results of a loop, each value once."""
    used: set[Value] = set()
    for output in program.outputs:
        values = output.values or ()
        for row in _rows(range(len(values)), output.shape):
            members = tuple(values[k] for k in row)
            if _are_results_of_one_loop(members) and not used & set(members):
                used |= set(members)
                yield members


def _are_results_of_one_loop(values: Members) -> bool:
    first = values[0]
    return (
        first.type != "b1"
        and all(value.op == "result" and value.args[0] is first.args[0] for value in values)
        and isinstance(first.args[0], Loop)
    )


COSTS = {"div": 4.0, "sqrt": 4.0}
"""Cost of an operation in instructions; 1 for all others."""


def keep_profitable(bundles: Bundles) -> None:
    """Remove, in place, the bundles whose vectors cost more instructions than they save."""
    costs = _CostModel(bundles)
    while True:
        costly = [members for members in bundles.slots if members in bundles.vectors and costs.gain(members) < 0.0]
        if not costly:
            return
        for members in costly:
            if costs.gain(members) < 0.0:
                costs.dissolve(members)


class _CostModel:
    """Cost model for vectors, from the users of each value and vector."""

    def __init__(self, bundles: Bundles) -> None:
        self.bundles = bundles
        self.scalar_uses: defaultdict[Value, int] = defaultdict(int)
        self.users: defaultdict[Members, set[Members]] = defaultdict(set)  # by vector, the vectors that use it
        self.slots: dict[Members, list[Members]] = dict(bundles.slots)
        for value in bundles.program.walk():
            if isinstance(value, Loop):
                self._loop(value)
            elif not bundles.is_vectorised(value):
                for arg in uses(value):
                    self.scalar_uses[arg] += 1
        for output in bundles.program.outputs:
            for value in output.values or ():
                self.scalar_uses[value] += 1
        for members in bundles.vectors:
            for slot in self.slots.get(members, ()):
                self.users[slot].add(members)

    def _loop(self, loop: Loop) -> None:
        self.scalar_uses[loop.condition] += 1
        for k, param in enumerate(loop.params):
            if not self.bundles.is_vectorised(param):
                self.scalar_uses[loop.args[k]] += 1
                self.scalar_uses[loop.following[k]] += 1
                continue
            members, lane = self.bundles.lane_of[param]
            if lane == 0:
                self.slots[members] = [loop.args[k : k + len(members)], loop.following[k : k + len(members)]]

    def gain(self, members: Members) -> float:
        """Return the number of instructions that a vector saves; negative if it costs more than it saves."""
        gain = (len(members) - 1) * COSTS.get(members[0].op, 1.0)
        for value in members:
            if self.scalar_uses[value]:
                gain -= _extraction_cost(self.bundles, value)
        if self.users[members]:
            gain += len(members) - 1
        for slot in set(self.slots[members]):
            if slot in self.bundles.vectors:
                gain += sum(_extraction_cost(self.bundles, value) for value in slot if not self.scalar_uses[value])
            elif len(self.users[slot]) == 1:
                gain -= self._gather_cost(slot)
        return gain

    def dissolve(self, members: Members) -> None:
        """Replace a vector by its members."""
        self.bundles.dissolve(members)
        for slot in set(self.slots[members]):
            self.users[slot].discard(members)
        for value in members:
            for arg in value.args:
                self.scalar_uses[arg] += 1

    def _gather_cost(self, slot: Members) -> float:
        """Return the cost of assembling a vector in instructions: 1 per additional piece, 0.5 per extraction."""
        if len(set(slot)) == 1:
            return 0.0 if slot[0].op == "const" else 1.0
        pieces = {self.bundles.lane_of[value][0] if self.bundles.is_vectorised(value) else (value,) for value in slot}
        return max(len(pieces) - 1.0, 0.0) + sum(0.5 for piece in pieces if len(piece) > 1)


def _extraction_cost(bundles: Bundles, value: Value) -> float:
    """Return the cost of extracting an element: the first lane is cheaper, and inputs are in memory."""
    if value.op == "input":
        return 0.0
    return 1.0 if bundles.lane_of[value][1] else 0.5
