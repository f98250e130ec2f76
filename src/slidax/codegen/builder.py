"""Build programs of the intermediate representation (IR), without duplicate or unused values.

An IR value is the scalar result of one operation. A region is a list of values that are computed one after the other:
the whole program, a part of a loop, or a side of a branch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from .fold import fold_operation
from .ir import FLOATS, Branch, Call, Input, Loop, Number, Output, Program, Region, Type, Value, regions


def _needed_values(program: Program) -> set[Value]:
    needed: set[Value] = set()
    pending: list[Value] = [value for output in program.outputs for value in output.values or ()]
    pending += [value for value in program.walk() if value.op == "store"]
    while pending:
        value = pending.pop()
        if value not in needed:
            needed.add(value)
            pending += _needs_of(value)
    return needed


def _needs_of(value: Value) -> Iterable[Value]:
    """Return the values that a needed value directly depends on."""
    if value.op == "param":
        loop = value.region.owner
        assert isinstance(loop, Loop)
        return loop, loop.args[value.data], loop.following[value.data]
    if value.op == "result":
        block = value.args[0]
        if isinstance(block, Loop):
            return block, block.params[value.data]
        if isinstance(block, Call):
            return (block,)
        assert isinstance(block, Branch)
        return block, block.yes[value.data], block.no[value.data]
    if isinstance(value, Loop):
        counter = () if value.iterations is None else (value.iterations, value.params[0])
        return *_blocks_around(value), value.condition, *counter
    if isinstance(value, Branch):
        return *_blocks_around(value), value.args[0]
    if value.op == "store":
        return *_blocks_around(value), *value.args
    return value.args


def _blocks_around(value: Value) -> tuple[Value, ...]:
    return () if value.region.owner is None else (value.region.owner,)


def _drop(region: Region, needed: set[Value]) -> None:
    region.values = [value for value in region.values if value in needed]
    indices: dict[Value, dict[int, int]] = {}
    for value in region.values:
        if value.op == "result" and value.args[0] in indices:
            value.data = indices[value.args[0]][value.data]
        elif isinstance(value, Loop):
            indices[value] = _drop_carried(value, needed)
        elif isinstance(value, Branch):
            left = {r.data for r in region.values if r.op == "result" and r.args[0] is value}
            kept = sorted(left)
            value.yes = tuple(value.yes[k] for k in kept)
            value.no = tuple(value.no[k] for k in kept)
            indices[value] = {k: index for index, k in enumerate(kept)}
        for inner in regions(value):
            _drop(inner, needed)


def _drop_carried(loop: Loop, needed: set[Value]) -> dict[int, int]:
    kept = [k for k, param in enumerate(loop.params) if param in needed]
    loop.args = tuple(loop.args[k] for k in kept)
    loop.following = tuple(loop.following[k] for k in kept)
    loop.params = tuple(loop.params[k] for k in kept)
    for index, param in enumerate(loop.params):
        param.data = index
    return {k: index for index, k in enumerate(kept)}


Values = np.ndarray
"""Array of `Value`s, with dtype object."""

COMMUTATIVE = frozenset({"add", "mul", "min", "max", "and", "or", "xor", "eq", "ne"})
COMPARISONS = frozenset({"eq", "ne", "lt", "le", "gt", "ge", "isfinite"})

LARGEST = 4_000_000
"""Largest number of values in a program: about 250 bytes each, 1 GB in all."""

LARGEST_CODE = 400_000
"""Largest number of operations in a program: for so many, LLVM needs a minute and 2 GB."""


class Builder:
    """Builder of one IR program.

    An operation that already exists in the same region or a surrounding one is reused. A value inside a loop is moved
    out of the loop if none of its arguments changes there. No value is moved out of a branch, since the branch may
    avoid an expensive operation.

    - `origin`: source location that is recorded for every value built from now on.

    A method raises NotImplementedError if the program would exceed `LARGEST` values or `LARGEST_CODE` operations.
    """

    def __init__(self) -> None:
        self.program = Program()
        self.region = self.program.body
        self.origin: Any = None
        self._count = 0
        self._operations = 0

    # ---- values -----------------------------------------------------------------------------------------------------

    def constant(self, number: Number, type: Type) -> Value:
        """Return a Python or NumPy number as a constant IR value."""
        if type in FLOATS:
            number = float(np.float32(number)) if type == "f32" else float(number)
            key: Any = number.hex()
        else:
            number = bool(number) if type == "b1" else int(number)
            key = number
        return self._known(self.program.body, ("const", type, key), "const", type, (), number)

    def input(self, name: str, type: Type, shape: tuple[int, ...], *, varying: bool = False) -> Values:
        """Add an input to the program, and return its elements as an array of IR values.

        - `varying`: true if the values differ between the runs of a batch (many runs of one program).
        """
        which = len(self.program.inputs)
        self.program.inputs.append(Input(name, type, shape, varying))
        array = np.empty(self.program.inputs[-1].size, object)
        for k in range(array.size):
            array[k] = self._new(self.program.body, "input", type, (), (which, k))
        return array.reshape(shape)

    def output(self, name: str, type: Type, values: Values) -> None:
        """Add an output to the program; `values`, an array of IR values, has its shape and elements."""
        self.program.outputs.append(Output(name, type, values.shape, tuple(values.ravel())))

    def logged(self, name: str, type: Type, shape: tuple[int, ...]) -> int:
        """Add an output that is a log: `store` writes it row by row. Return its index among the outputs.

        - `shape`: shape of one row.
        """
        self.program.outputs.append(Output(name, type, shape, None))
        return len(self.program.outputs) - 1

    def store(self, output: int, row: Value, when: Value, values: Values) -> None:
        """Add an operation that writes one row of a log.

        - `output`: index of the log among the outputs, from `logged`.
        - `row`: index of the row, an i64 value.
        - `when`: truth value (b1); if it is false, nothing is written.
        - `values`: elements of the row, as IR values.
        """
        self._new(self.region, "store", "none", (row, when, *values.ravel()), output)

    # ---- operations -------------------------------------------------------------------------------------------------

    def apply(self, op: str, *args: Value, type: Type | None = None, data: Any = None) -> Value:
        """Return an IR value for the result of an operation: a simpler or existing one if possible, else a new one.

        - `op`, `args`, `data`: as in `Value`.
        - `type`: type of the result; None: that of the last argument, or b1 for comparisons.
        """
        if type is None:
            type = "b1" if op in COMPARISONS else args[-1].type
        if op in COMMUTATIVE and args[0].number > args[1].number:
            args = (args[1], args[0])
        simpler = fold_operation(self, op, type, args)
        if simpler is not None:
            return simpler
        region = self._region_for(args)
        key = (op, type, data, *[arg.number for arg in args])
        return self._known(region, key, op, type, args, data)

    def loop(
        self,
        carried: Sequence[Value],
        condition: Callable[[tuple[Value, ...]], Value],
        body: Callable[[tuple[Value, ...]], Sequence[Value]],
        iterations: Value | None = None,
    ) -> list[Value]:
        """Add the loop `while condition(carried): carried = body(carried)`; return the carried values after it.

        - `carried`: initial values.
        - `condition`: function from the carried values to a truth value (b1).
        - `body`: function from the carried values to their successors, of the same types.
        - `iterations`: number of iterations if known; the first carried value must then count them from 0.

        Raises TypeError if `body` changes the number or the types of the carried values.
        """
        head = Region("head", self.region)
        loop = Loop("loop", "none", tuple(carried), None, self.region, self._next(), self.origin)
        loop.head, loop.body, loop.iterations = head, Region("body", head), iterations
        loop.head.owner = loop.body.owner = loop
        loop.params = tuple(
            Value("param", value.type, (), k, head, self._next(), self.origin) for k, value in enumerate(carried)
        )
        with self._inside(head):
            loop.condition = condition(loop.params)
        with self._inside(loop.body):
            loop.following = tuple(body(loop.params))
        _require_types(loop.params, loop.following)
        self.region.values.append(loop)
        return self._results(loop, carried)

    def branch(
        self, when: Value, then: Callable[[], Sequence[Value]], otherwise: Callable[[], Sequence[Value]]
    ) -> list[Value]:
        """Add a branch, `then() if when else otherwise()`, and return its results. A run computes only the chosen side.

        - `when`: truth value (b1).
        - `then`, `otherwise`: functions that add the operations of a side and return its results. Both sides must have
          equally many results, of the same types.

        A constant `when`, or one that a surrounding branch has decided, adds only the chosen side.

        Raises TypeError if the results of the sides differ in number or type.
        """
        known = when.data if when.op == "const" else self._decided(when)
        if known is not None:
            return list(then() if known else otherwise())
        block = Branch("branch", "none", (when,), None, self.region, self._next(), self.origin)
        block.then, block.otherwise = Region("branch", self.region), Region("branch", self.region)
        block.then.owner = block.otherwise.owner = block
        with self._inside(block.then):
            block.yes = tuple(then())
        with self._inside(block.otherwise):
            block.no = tuple(otherwise())
        _require_types(block.yes, block.no)
        self.region.values.append(block)
        results = self._results(block, block.yes)
        # A value that both sides return does not depend on the branch.
        return [yes if yes is no else result for yes, no, result in zip(block.yes, block.no, results, strict=True)]

    def call(self, program: Program, args: Sequence[Value]) -> list[Value]:
        """Add a call of another program, or reuse an equal call; return the outputs' elements, output by output.

        - `program`: the called program; it must not have logs.
        - `args`: elements of its inputs, input by input.
        """
        region = self._region_for(tuple(args))
        key = ("call", id(program), *[arg.number for arg in args])
        around: Region | None = region
        while around is not None and key not in around.known:
            around = around.parent
        if around is not None:
            call = around.known[key]
            return [value for value in around.values if value.op == "result" and value.args[0] is call]
        call = Call("call", "none", tuple(args), None, region, self._next(), self.origin)
        call.program = program
        region.known[key] = call
        region.values.append(call)
        types = [value.type for output in program.outputs for value in output.values or ()]
        return [self._new(region, "result", type, (call,), k) for k, type in enumerate(types)]

    def finish(self) -> Program:
        """Remove all values that no output and no log needs, and return the program."""
        _drop(self.program.body, _needed_values(self.program))
        return self.program

    # ---- inside -----------------------------------------------------------------------------------------------------

    def _decided(self, when: Value) -> bool | None:
        """Return the value of a condition in this region, if a surrounding branch has the same condition; else None."""
        region: Region | None = self.region
        while region is not None:
            block = region.owner
            if isinstance(block, Branch) and block.args[0] is when:
                return region is block.then
            region = region.parent
        return None

    def _next(self) -> int:
        self._count += 1
        return self._count

    def _new(self, region: Region, op: str, type: Type, args: tuple[Value, ...], data: Any) -> Value:
        if args:
            self._operations += 1
        if self._count >= LARGEST or self._operations > LARGEST_CODE:
            raise NotImplementedError(
                f"programs of more than {LARGEST_CODE} operations or {LARGEST} values; each element of an array "
                "counts: use smaller arrays, or simulate with the engine `xla`"
            )
        value = Value(op, type, args, data, region, self._next(), self.origin)
        region.values.append(value)
        return value

    def _known(self, region: Region, key: Any, op: str, type: Type, args: tuple[Value, ...], data: Any) -> Value:
        around: Region | None = region
        while around is not None:
            value = around.known.get(key)
            if value is not None:
                return value
            around = around.parent
        value = self._new(region, op, type, args, data)
        region.known[key] = value
        return value

    def _region_for(self, args: tuple[Value, ...]) -> Region:
        region = self.region
        while region.kind in ("head", "body"):
            # A value of the body that depends on carried values stays there: the head runs once more than the body.
            head = region.parent if region.kind == "body" else region
            assert head is not None
            assert head.parent is not None
            for arg in args:
                if arg.region is region or arg.region is head:
                    return region
            region = head.parent
        return region

    def _results(self, block: Value, like: Sequence[Value]) -> list[Value]:
        # Results have the origin of their block, not of its last value.
        self.origin = block.origin
        return [self._new(self.region, "result", value.type, (block,), k) for k, value in enumerate(like)]

    @contextmanager
    def _inside(self, region: Region) -> Iterator[None]:
        around, self.region = self.region, region
        try:
            yield
        finally:
            self.region = around


def _require_types(before: Sequence[Value], after: Sequence[Value]) -> None:
    if [value.type for value in before] != [value.type for value in after]:
        raise TypeError(
            f"types {[v.type for v in before]} became {[v.type for v in after]}: an iteration must not change the "
            "types of carried values, and both sides of a branch must return the same types"
        )
