"""Decide which values generated C computes, in which block of code, and which depend only on parameters.

A region is a list of values: the whole program, a part of a loop, or a side of a branch.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator

from ..ir import ELEMENTARY, Branch, Loop, Program, Region, Value, regions, uses, walk


class Placement:
    """Choice of the region in which generated C computes each value: outside loops, and inside branches, if possible.

    `order` lists the values of each region in a valid order of computation. `uses` counts how often a value is an
    operand. `assigned` has the values that are assigned to an output, to a variable that a loop changes, or to the
    result of a branch.

    - `wanted`: requested values, and operations that write logs; only these and the values that they need are placed.
    - `precomputed`: values that need no computation.
    """

    def __init__(self, program: Program, wanted: Iterable[Value], precomputed: Collection[Value] = ()) -> None:
        self.body = program.body
        self.precomputed = precomputed
        self.wanted = list(wanted)
        self.uses: dict[Value, int] = defaultdict(int)
        self.assigned: set[Value] = set()
        self.place: dict[Value, Region] = {}
        self.order: dict[Region, list[Value]] = defaultdict(list)
        self.needed = self._all_needed()
        # The order of construction is a valid order of computation if each block comes just before its results.
        keys = {value: self._key(value) for value in self.needed if value.op != "param"}
        self._used_in: dict[Value, Region] = {}
        for value in self.wanted:
            if value.op != "store":
                self._assign(value, self.body)
        for value in sorted(keys, key=lambda value: -keys[value]):
            self._place_value(value)
        for value in sorted(keys, key=lambda value: keys[value]):
            self.order[self.place[value]].append(value)

    def carried(self, loop: Loop) -> list[int]:
        """Return the indices of a loop's needed carried values, which pass from one iteration to the next."""
        return [k for k, param in enumerate(loop.params) if param in self.needed]

    def results_of(self, block: Value) -> dict[int, Value]:
        """Return the needed results of a loop, branch or call, by their index among all its results."""
        return {value.data: value for value in self.results.get(block, ())}

    def parent(self, region: Region) -> Region | None:
        """Return the region that surrounds another one after placement; None for the outermost region."""
        if region.kind == "body":
            return region.parent
        return None if region.owner is None else self.place[region.owner]

    def has_single_use(self, value: Value) -> bool:
        """True if a needed value is used exactly once, in the region in which it is computed."""
        return self.uses[value] == 1 and self._used_in[value] is self.place[value]

    # ---- needed values ----------------------------------------------------------------------------------------------

    def _all_needed(self) -> set[Value]:
        needed: set[Value] = set()
        pending = list(self.wanted)
        while pending:
            value = pending.pop()
            if value not in needed:
                needed.add(value)
                pending += self._needs_of(value)
        self.results: dict[Value, list[Value]] = defaultdict(list)
        for value in sorted(needed, key=lambda value: value.number):
            if value.op == "result" and value not in self.precomputed:
                self.results[value.args[0]].append(value)
        return needed

    def _needs_of(self, value: Value) -> Iterator[Value]:
        """Yield the values that a needed value directly depends on."""
        if value in self.precomputed:
            return
        if value.op == "param":
            loop = value.region.owner
            assert isinstance(loop, Loop)
            yield loop
            if not is_counter(value):
                yield from (loop.args[value.data], loop.following[value.data])
        elif value.op == "result":
            block = value.args[0]
            yield block
            if isinstance(block, Loop):
                yield block.params[value.data]
            elif isinstance(block, Branch):
                yield from (block.yes[value.data], block.no[value.data])
        elif isinstance(value, Loop):
            yield value.condition if value.iterations is None else value.iterations
            if value.iterations is not None:
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

    # ---- regions ----------------------------------------------------------------------------------------------------

    def _place_value(self, value: Value) -> None:
        """Choose the region of a value whose users are all placed, and record the values that it uses."""
        if value.op in ("store", "call") or regions(value):
            self._put_block(value)
            return
        if value.op == "result" and value not in self.precomputed:
            # Its block is placed next, and determines the region.
            return
        self.place[value] = place = self._outside_loops(value, self._used_in[value])
        if value not in self.precomputed:
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
        for member in (value, *left):
            self.place[member] = place
        if isinstance(value, Loop):
            for k in self.carried(value):
                if not is_counter(value.params[k]):
                    self._assign(value.args[k], place)
                    self._assign(value.following[k], value.body)
            self._use(value.condition, value.head) if value.iterations is None else self._use(value.iterations, place)
        elif isinstance(value, Branch):
            self._use(value.args[0], place)
            for k in self.results_of(value):
                self._assign(value.yes[k], value.then)
                self._assign(value.no[k], value.otherwise)
        elif value.op == "call":
            for arg in value.args:
                self._pass(arg, place)
        else:
            for arg in value.args:
                self._use(arg, place)

    def _pass(self, value: Value, region: Region) -> None:
        """Record that a call needs a value. An input is read in place: for an input, this does not count as a use."""
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

    def _around(self, first: Region, second: Region) -> Region:
        """Return the innermost region around both."""
        path = set(self._path(first))
        return next(region for region in self._path(second) if region in path)

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


def is_counter(param: Value) -> bool:
    """True if a carried value (`param`) counts the iterations of its loop."""
    loop = param.region.owner
    return isinstance(loop, Loop) and loop.iterations is not None and param.data == 0


def is_counter_increment(value: Value) -> bool:
    """True if a value increments a 64-bit counter by steps too small for an overflow; C then writes a plain `+`."""
    if value.op != "add" or value.type != "i64":
        return False
    for more, param in (value.args, value.args[::-1]):
        loop = param.region.owner
        if param.op == "param" and isinstance(loop, Loop) and loop.following[param.data] is value:
            is_bit = more.op == "convert" and more.args[0].type == "b1"
            return (is_bit or _is_small(more)) and _is_small(loop.args[param.data])
    return False


def _is_small(value: Value) -> bool:
    return value.op == "const" and abs(value.data) < 2**31


def _inside(block: Value) -> Iterator[Value]:
    for region in regions(block):
        yield from walk(region)


EXPENSIVE = frozenset(ELEMENTARY) | {"div", "rem", "sqrt"}
WORTH = 4
"""Least number of additions whose result is worth storing. The result of an `EXPENSIVE` operation always is."""


def loop_invariant(program: Program, inputs: Collection[int]) -> list[Value]:
    """Return the values that depend only on some inputs and constants, and are worth storing between calls.

    To compute them in a separate C function, pass them to `statements` as `assigned`. For the function with the rest of
    the program, pass them as `precomputed`. Values inside branches are included: computing them is always harmless.

    - `inputs`: indices of the inputs that rarely change.
    """
    return _LoopInvariant(program, inputs).values()


class _LoopInvariant:
    """Search for the values that depend only on some inputs; `guarded` is True inside a branch."""

    def __init__(self, program: Program, inputs: Collection[int]) -> None:
        self.program = program
        self.inputs = inputs
        self.invariant: dict[Value, None] = {}  # in an order of computation
        self.inner: set[Value] = set()  # contents of invariant blocks
        self._region(program.body, guarded=False)

    def values(self) -> list[Value]:
        """Return the values that the rest of the program needs, and that are expensive to compute from each other."""
        needed = {value for output in self.program.outputs for value in output.values or ()}
        for value in self.program.walk():
            if value not in self.invariant and value not in self.inner:
                needed.update(uses(value))
        values: list[Value] = []
        cost: dict[Value, int] = {}
        for value in self.invariant:
            own = WORTH if value.op in EXPENSIVE or value.op == "result" else 0 if value.op in ("const", "input") else 1
            cost[value] = min(own + sum(cost[arg] for arg in value.args if not regions(arg)), WORTH)
            if value in needed and cost[value] == WORTH:
                values.append(value)
                cost[value] = 0
        return values

    def _region(self, region: Region, guarded: bool) -> None:
        for value in region.values:
            if regions(value):
                self._block(value, guarded)
            elif value.op == "const" or (value.op == "input" and value.data[0] in self.inputs):
                self.invariant[value] = None
            elif value.op == "result":
                if value.args[0] in self.invariant:
                    self.invariant[value] = None
            elif self._is_invariant(value, guarded):
                self.invariant[value] = None

    def _is_invariant(self, value: Value, guarded: bool) -> bool:
        if value.op in ("input", "store") or not all(arg in self.invariant for arg in value.args):
            return False
        # Outside the branch that guards a load, its index may be out of range.
        return value.op != "load" or (value.data in self.inputs and not guarded)

    def _block(self, block: Value, guarded: bool) -> None:
        inner = {value for region in regions(block) for value in walk(region)}
        if isinstance(block, Loop):
            inner.update(block.params)
        inner |= {param for value in inner if isinstance(value, Loop) for param in value.params}
        if self._is_invariant_block(block, inner, guarded):
            self.invariant[block] = None
            self.inner |= inner
            return
        for region in regions(block):
            self._region(region, guarded or isinstance(block, Branch))

    def _is_invariant_block(self, block: Value, inner: set[Value], guarded: bool) -> bool:
        for value in (block, *inner):
            if value.op in ("store", "input") or (value.op == "load" and (value.data not in self.inputs or guarded)):
                return False
            # The branch may protect against an endless loop.
            if guarded and isinstance(value, Loop) and value.iterations is None:
                return False
            if not all(need in inner or need in self.invariant for need in _needs(value)):
                return False
        return True


def _needs(value: Value) -> Iterator[Value]:
    yield from uses(value)
    if isinstance(value, Loop) and value.iterations is not None:
        yield value.iterations
