"""Prepare a program for the CPU: expand elementary functions, fuse multiply-adds, vectorise, and order operations."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass
from itertools import count

from ..builder import Builder
from ..elementary.lowering import lower
from ..ir import ELEMENTARY, Branch, Loop, Program, Region, Value, regions
from ..passes import fuse_products, rebuild
from .order import put_in_order
from .slp import Bundles, Members, keep_profitable


@dataclass(slots=True, eq=False, repr=False)
class Vector(Value):
    """IR value for several scalars of one run that one CPU instruction computes.

    In addition to the IR's operations, `op` can be `gather` (a vector from scalars) or `spread` (a vector of equal
    scalars). A scalar with the operation `pick` is the element of a vector with the index `data`.

    - `lanes`: number of scalars.
    """

    lanes: int = 1


def vectorise(program: Program) -> None:
    """Replace similar scalar operations of a program by vector operations, in place, where that saves time.

    Afterwards the operations are unordered: call `put_in_order` next.
    """
    bundles = Bundles(program)
    keep_profitable(bundles)
    _Vectoriser(program, bundles).run()


class _Vectoriser:
    """Replaces the bundles of a program, in place."""

    def __init__(self, program: Program, bundles: Bundles) -> None:
        self.program = program
        self.bundles = bundles
        self.numbers = count(1 + max((value.number for value in _all(program.body)), default=0))
        self.vectors: dict[Members, Vector] = {}
        self.results: dict[Members, Vector] = {}  # results of loops, by their parameters
        self.picks: dict[Value, Value] = {}
        self.added: list[Value] = []

    def run(self) -> None:
        for members in self.bundles.vectors:
            first = members[0]
            self.vectors[members] = self._vector(first.op, first, (), first.data, len(members))
        for members, slots in self.bundles.slots.items():
            if members in self.bundles.vectors:
                self.vectors[members].args = tuple(self._argument(slot) for slot in slots)
        self._region(self.program.body)
        for output in self.program.outputs:
            if output.values is not None:
                output.values = tuple(self._scalar(value) for value in output.values)
        for value in self.added:
            value.region.values.append(value)

    # ---- values -----------------------------------------------------------------------------------------------------

    def _vector(self, op: str, like: Value, args: tuple[Value, ...], data: object, lanes: int) -> Vector:
        return Vector(op, like.type, args, data, like.region, next(self.numbers), lanes=lanes)

    def _scalar(self, value: Value) -> Value:
        """Return a value as a scalar, extracted from its vector if necessary."""
        if not self.bundles.is_vectorised(value):
            return value
        if value not in self.picks:
            members, k = self.bundles.lane_of[value]
            vector = self.vectors[members]
            # An input is instead read from memory again.
            scalar = value
            if value.op != "input":
                scalar = Value("pick", value.type, (vector,), k, vector.region, next(self.numbers))
            self.picks[value] = scalar
            self.added.append(scalar)
        return self.picks[value]

    def _argument(self, members: Members) -> Value:
        """Return the vector of some values; if all are the same constant, return this constant."""
        if members in self.vectors:
            return self.vectors[members]
        first = members[0]
        uniform = all(value is first for value in members)
        if uniform and first.op == "const":
            return first
        scalars = tuple(self._scalar(value) for value in members)
        innermost = max(scalars, key=lambda value: _depth(value.region))
        vector = self._vector(
            "spread" if uniform else "gather", innermost, scalars[:1] if uniform else scalars, None, len(members)
        )
        self.vectors[members] = vector
        self.added.append(vector)
        return vector

    def _group(self, values: Sequence[Value]) -> tuple[Value, ...]:
        """Return a loop's parameters, with bundles replaced by their vectors."""
        grouped: list[Value] = []
        k = 0
        while k < len(values):
            vectorised = self.bundles.is_vectorised(values[k])
            value = self.vectors[self.bundles.lane_of[values[k]][0]] if vectorised else values[k]
            grouped.append(value)
            k += value.lanes if isinstance(value, Vector) else 1
        return tuple(grouped)

    # ---- regions ----------------------------------------------------------------------------------------------------

    def _region(self, region: Region) -> None:
        values: list[Value] = []
        for value in region.values:
            if self.bundles.is_vectorised(value):
                members, k = self.bundles.lane_of[value]
                if k == 0:
                    values.append(self.vectors[members])
                continue
            values.append(value)
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
        region.values = values

    def _loop(self, loop: Loop) -> None:
        self._region(loop.head)
        self._region(loop.body)
        before = loop.params
        loop.params = self._group(before)
        indices: dict[int, int] = {}
        k = 0
        args: list[Value] = []
        following: list[Value] = []
        for index, param in enumerate(loop.params):
            indices[k] = index
            param.data = index
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
                self._result(loop, value, before[value.data], indices)

    def _result(self, loop: Loop, value: Value, param: Value, indices: dict[int, int]) -> None:
        if not self.bundles.is_vectorised(param):
            value.data = indices[value.data]
            return
        members, k = self.bundles.lane_of[param]
        vector = self.results.get(members)
        if vector is None:
            vector = self._vector("result", value, (loop,), indices[value.data - k], len(members))
            self.results[members] = vector
            self.added.append(vector)
        value.op, value.args, value.data = "pick", (vector,), k

    def _full(self, members: Members) -> Value:
        """Return the vector of some values, even if all are the same constant."""
        value = self._argument(members)
        if not isinstance(value, Vector):
            value = self.vectors[members] = self._vector("spread", value, (value,), None, len(members))
            self.added.append(value)
        return value


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


FUNCTIONS = frozenset(ELEMENTARY)

CALLED = FUNCTIONS - {"exp", "erf_inv"}
"""Elementary functions that `quick` code calls. The others end with a product, which may be fused into a sum."""


def prepare(program: Program, lanes: int = 1, *, quick: bool = False) -> Program:
    """Return a copy of a program that is ready to be printed as LLVM IR: expanded, vectorised and ordered.

    - `lanes`: number of runs that are computed in parallel. With 1, similar operations of one run, such as those of all
      joints, become vector operations.
    - `quick`: True for a quick preparation: the elementary functions in `CALLED` are called, not expanded; no vectors;
      order unchanged.
    """
    if quick:
        return lower_and_fuse(program, FUNCTIONS - CALLED)
    ready = lower_and_fuse(program)
    if lanes == 1:
        vectorise(ready)
    put_in_order(ready)
    return ready


def lower_and_fuse(program: Program, lowered: Set[str] = FUNCTIONS) -> Program:
    """Return a copy of a program with fused multiply-adds, and elementary functions as correctly rounded operations.

    - `lowered`: names of the elementary functions to expand; those of constants are always expanded.
    """

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op in FUNCTIONS:
            known = all(arg.op == "const" for arg in args)
            return lower(builder, value.op, args) if known or value.op in lowered else None
        return fuse_products(builder, value, args)

    return rebuild(program, replace)
