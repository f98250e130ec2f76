"""Which values are printed, and where: in the innermost block around all their uses, but in no loop around them alone.

So a value that only one side of a branch needs is computed there, and one that is wanted for itself, out of the branch
that it was made in. What does not depend on the runs of a loop stays outside of it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator

from ..ir import Branch, Loop, Program, Region, Value, regions, uses, walk


class Placement:
    """Where to compute what some values need.

    - `program`: that they belong to.
    - `wanted`: the values; and stores.
    - `given`: values that are known already.

    `order` has the values of each region, in an order in which they can be computed; `uses` says how often each is an
    operand, and `assigned` has those that are assigned to something: to an output, a carried number, a branch's result.
    """

    def __init__(self, program: Program, wanted: Iterable[Value], given: Collection[Value] = ()) -> None:
        self.body = program.body
        self.given = given
        self.wanted = list(wanted)
        self.uses: dict[Value, int] = defaultdict(int)
        self.assigned: set[Value] = set()
        self.place: dict[Value, Region] = {}
        self.order: dict[Region, list[Value]] = defaultdict(list)
        self.needed = self._all_needed()
        # The order of making is one in which all can be computed, if a block comes just before what it leaves.
        keys = {value: self._key(value) for value in self.needed if value.op != "param"}
        self._used_in: dict[Value, Region] = {}
        for value in self.wanted:
            if value.op != "store":
                self._assign(value, self.body)
        for value in sorted(keys, key=lambda value: -keys[value]):
            self._put(value)
        for value in sorted(keys, key=lambda value: keys[value]):
            self.order[self.place[value]].append(value)

    def kept(self, loop: Loop) -> list[int]:
        """Which of the numbers that a loop carries are needed.

        - `loop`: the loop.
        """
        return [k for k, param in enumerate(loop.params) if param in self.needed]

    def left(self, block: Value) -> dict[int, Value]:
        """What is needed of what a loop or a branch leaves, by number.

        - `block`: the loop or branch.
        """
        return {value.data: value for value in self.results.get(block, ())}

    def parent(self, region: Region) -> Region | None:
        """The region around another one, as placed.

        - `region`: the inner one.
        """
        if region.kind == "body":
            return region.parent
        return None if region.owner is None else self.place[region.owner]

    def alone(self, value: Value) -> bool:
        """Whether a value has one use, in the block that it is placed in.

        - `value`: a needed one.
        """
        return self.uses[value] == 1 and self._used_in[value] is self.place[value]

    # ---- what is needed ---------------------------------------------------------------------------------------------

    def _all_needed(self) -> set[Value]:
        needed: set[Value] = set()
        asked = list(self.wanted)
        while asked:
            value = asked.pop()
            if value not in needed:
                needed.add(value)
                asked += self._for(value)
        self.results: dict[Value, list[Value]] = defaultdict(list)
        for value in sorted(needed, key=lambda value: value.number):
            if value.op == "result" and value not in self.given:
                self.results[value.args[0]].append(value)
        return needed

    def _for(self, value: Value) -> Iterator[Value]:
        """What a needed value needs at once."""
        if value in self.given:
            return
        if value.op == "param":
            loop = value.region.owner
            assert isinstance(loop, Loop)
            yield loop
            if not counts(value):
                yield from (loop.args[value.data], loop.following[value.data])
        elif value.op == "result":
            block = value.args[0]
            yield block
            if isinstance(block, Loop):
                yield block.params[value.data]
            elif isinstance(block, Branch):
                yield from (block.yes[value.data], block.no[value.data])
        elif isinstance(value, Loop):
            yield value.condition if value.turns is None else value.turns
            if value.turns is not None:
                yield value.params[0]
        elif isinstance(value, Branch):
            yield value.args[0]
        else:
            yield from value.args
        if value.op == "store":
            region = value.region
            while region.owner is not None:
                yield region.owner
                region = region.owner.region

    def _key(self, value: Value) -> float:
        if not regions(value):
            return float(value.number)
        if self.results.get(value):
            return min(result.number for result in self.results[value]) - 0.5
        return max(need.number for inner in (value, *_inside(value)) for need in (inner, *uses(inner))) + 0.5

    # ---- where it goes ----------------------------------------------------------------------------------------------

    def _put(self, value: Value) -> None:
        """Places a value all of whose uses are placed, and makes known where it uses others."""
        if value.op in ("store", "call") or regions(value):
            self._put_block(value)
            return
        if value.op == "result" and value not in self.given:
            # Its block is placed next, and decides.
            return
        self.place[value] = place = self._outside_loops(value, self._used_in[value])
        if value not in self.given:
            for arg in value.args:
                self._use(arg, place)

    def _put_block(self, value: Value) -> None:
        left = self.results.get(value, [])
        if value.op == "store" or any(inner.op == "store" and inner in self.needed for inner in _inside(value)):
            place = value.region
        else:
            place = self._used_in[left[0]]
            for result in left[1:]:
                place = self._around(place, self._used_in[result])
            place = self._outside_loops(value, place)
        for one in (value, *left):
            self.place[one] = place
        if isinstance(value, Loop):
            for k in self.kept(value):
                if not counts(value.params[k]):
                    self._assign(value.args[k], place)
                    self._assign(value.following[k], value.body)
            self._use(value.condition, value.head) if value.turns is None else self._use(value.turns, place)
        elif isinstance(value, Branch):
            self._use(value.args[0], place)
            for k in self.left(value):
                self._assign(value.yes[k], value.then)
                self._assign(value.no[k], value.otherwise)
        elif value.op == "call":
            for arg in value.args:
                self._pass(arg, place)
        else:
            for arg in value.args:
                self._use(arg, place)

    def _pass(self, value: Value, region: Region) -> None:
        """An argument of a call: an input is read where it lies."""
        self._use(value, region)
        if value.op == "input":
            self.uses[value] -= 1

    def _assign(self, value: Value, region: Region) -> None:
        self.assigned.add(value)
        self._use(value, region)

    def _use(self, value: Value, region: Region) -> None:
        self.uses[value] += 1
        before = self._used_in.get(value)
        self._used_in[value] = region if before is None else self._around(before, region)

    def _around(self, one: Region, other: Region) -> Region:
        """The innermost region around both."""
        path = set(self._path(one))
        return next(region for region in self._path(other) if region in path)

    def _path(self, region: Region) -> Iterator[Region]:
        around: Region | None = region
        while around is not None:
            yield around
            around = self.parent(around)

    def _outside_loops(self, value: Value, region: Region) -> Region:
        place = region
        for around in self._path(region):
            if around.kind == "head" and not value.region.within(around):
                outside = self.parent(around)
                assert outside is not None
                place = outside
        return place


def counts(param: Value) -> bool:
    """Whether a number that a loop carries is the one that counts its turns.

    - `param`: the number.
    """
    loop = param.region.owner
    return isinstance(loop, Loop) and loop.turns is not None and param.data == 0


def counts_by_little(value: Value) -> bool:
    """Whether a value is what a loop's 64-bit counter is next: too little more for it ever to overflow.

    - `value`: any.
    """
    if value.op != "add" or value.type != "i64":
        return False
    for more, param in (value.args, value.args[::-1]):
        loop = param.region.owner
        if param.op == "param" and isinstance(loop, Loop) and loop.following[param.data] is value:
            little = more.op == "convert" and more.args[0].type == "b1"
            return (little or _is_little(more)) and _is_little(loop.args[param.data])
    return False


def _is_little(value: Value) -> bool:
    return value.op == "const" and abs(value.data) < 2**31


def _inside(block: Value) -> Iterator[Value]:
    for region in regions(block):
        yield from walk(region)
