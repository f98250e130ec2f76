"""A program with vectors in it, in place of what lies side by side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

from slidax.codegen.ir import Branch, Loop, Program, Region, Type, Value, regions

from .cost_model import keep_profitable
from .slp import Bundles, Members


class Vector(Value):
    """Numbers computed by one instruction.

    Beside the IR's operations, its `op` is `gather`, of as many numbers as there are lanes, or `spread`, of one. A
    number is taken from it by a `pick`, with its place as `data`.

    - `lanes`: how many.
    """

    __slots__ = ("lanes",)

    def __init__(
        self, op: str, type: Type, args: tuple[Value, ...], data: object, region: Region, number: int, lanes: int
    ) -> None:
        super().__init__(op, type, args, data, region, number, None)
        self.lanes = lanes


def vectorise(program: Program) -> None:
    """Puts a vector into the place of all numbers of one run that can be computed side by side, where that pays.

    - `program`: changed in place. Its values are in no order then: `put_in_order` has to follow.
    """
    bundles = Bundles(program)
    keep_profitable(bundles)
    _Vectoriser(program, bundles).run()


class _Vectoriser:
    """The vectors made so far.

    - `program`: is changed.
    - `bundles`: what lies side by side in it.
    """

    def __init__(self, program: Program, bundles: Bundles) -> None:
        self.program = program
        self.bundles = bundles
        self.numbers = count(1 + max((value.number for value in _all(program.body)), default=0))
        self.vectors: dict[Members, Vector] = {}
        self.left: dict[Members, Vector] = {}  # by what a loop carries, the same after it
        self.picks: dict[Value, Value] = {}
        self.added: list[Value] = []

    def run(self) -> None:
        for members in self.bundles.made:
            first = members[0]
            self.vectors[members] = self._vector(first.op, first, (), first.data, len(members))
        for members, slots in self.bundles.slots.items():
            if members in self.bundles.made:
                self.vectors[members].args = tuple(self._argument(slot) for slot in slots)
        self._region(self.program.body)
        for output in self.program.outputs:
            if output.values is not None:
                output.values = tuple(self._scalar(value) for value in output.values)
        for value in self.added:
            value.region.values.append(value)

    # ---- values -----------------------------------------------------------------------------------------------------

    def _vector(self, op: str, like: Value, args: tuple[Value, ...], data: object, lanes: int) -> Vector:
        return Vector(op, like.type, args, data, like.region, next(self.numbers), lanes)

    def _scalar(self, value: Value) -> Value:
        """A number that stands alone, or is taken from its vector."""
        if not self.bundles.is_made(value):
            return value
        if value not in self.picks:
            members, k = self.bundles.place[value]
            vector = self.vectors[members]
            # What lies in memory can be read once more.
            picked = value
            if value.op != "input":
                picked = Value("pick", value.type, (vector,), k, vector.region, next(self.numbers), None)
            self.picks[value] = picked
            self.added.append(picked)
        return self.picks[value]

    def _argument(self, members: Members) -> Value:
        """The vector of some numbers, or one number if it is the same in all lanes and known."""
        if members in self.vectors:
            return self.vectors[members]
        first = members[0]
        alike = all(value is first for value in members)
        if alike and first.op == "const":
            return first
        scalars = tuple(self._scalar(value) for value in members)
        where = max(scalars, key=lambda value: _depth(value.region))
        vector = self._vector(
            "spread" if alike else "gather", where, scalars[:1] if alike else scalars, None, len(members)
        )
        self.vectors[members] = vector
        self.added.append(vector)
        return vector

    def _several(self, values: Sequence[Value]) -> tuple[Value, ...]:
        """Numbers with vectors in place of those that are one: what a loop carries."""
        some: list[Value] = []
        k = 0
        while k < len(values):
            place = self.bundles.place.get(values[k])
            if place is not None and place[0] in self.bundles.made:
                some.append(self.vectors[place[0]])
                k += len(place[0])
            else:
                some.append(values[k])
                k += 1
        return tuple(some)

    # ---- regions ----------------------------------------------------------------------------------------------------

    def _region(self, region: Region) -> None:
        kept: list[Value] = []
        for value in region.values:
            if self.bundles.is_made(value):
                members, k = self.bundles.place[value]
                if k == 0:
                    kept.append(self.vectors[members])
                continue
            kept.append(value)
            if isinstance(value, Loop):
                self._loop(value)
            elif isinstance(value, Branch):
                self._region(value.then)
                self._region(value.otherwise)
                value.args = (self._scalar(value.args[0]),)
                value.yes = tuple(self._scalar(leaf) for leaf in value.yes)
                value.no = tuple(self._scalar(leaf) for leaf in value.no)
            else:
                value.args = tuple(self._scalar(arg) for arg in value.args)
        region.values = kept

    def _loop(self, loop: Loop) -> None:
        self._region(loop.head)
        self._region(loop.body)
        before = loop.params
        loop.params = self._several(before)
        places: dict[int, int] = {}
        k = 0
        args: list[Value] = []
        following: list[Value] = []
        for place, param in enumerate(loop.params):
            places[k] = place
            param.data = place
            if isinstance(param, Vector):
                args.append(self._full(loop.args[k : k + param.lanes]))
                following.append(self._full(loop.following[k : k + param.lanes]))
                k += param.lanes
            else:
                args.append(self._scalar(loop.args[k]))
                following.append(self._scalar(loop.following[k]))
                k += 1
        loop.args, loop.following = tuple(args), tuple(following)
        loop.condition = self._scalar(loop.condition)
        for value in loop.region.values:
            if value.op == "result" and value.args[0] is loop:
                self._result(loop, value, before[value.data], places)

    def _result(self, loop: Loop, value: Value, param: Value, places: dict[int, int]) -> None:
        if not self.bundles.is_made(param):
            value.data = places[value.data]
            return
        members, k = self.bundles.place[param]
        vector = self.left.get(members)
        if vector is None:
            vector = self._vector("result", value, (loop,), places[value.data - k], len(members))
            self.left[members] = vector
            self.added.append(vector)
        value.op, value.args, value.data = "pick", (vector,), k

    def _full(self, members: Members) -> Value:
        """The same as an argument, but a vector in any case."""
        found = self._argument(members)
        if not isinstance(found, Vector):
            found = self.vectors[members] = self._vector("spread", found, (found,), None, len(members))
            self.added.append(found)
        return found


def _all(region: Region) -> list[Value]:
    values: list[Value] = []
    for value in region.values:
        values.append(value)
        if isinstance(value, Loop):
            values += value.params
        for inner in regions(value):
            values += _all(inner)
    return values


def _depth(region: Region) -> int:
    depth = 0
    around = region.parent
    while around is not None:
        depth += 1
        around = around.parent
    return depth
