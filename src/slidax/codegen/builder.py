"""Makes programs: one value for each operation on the same arguments, computed where it is needed and no more often."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from .fold import folded
from .ir import FLOATS, Branch, Call, Input, Loop, Number, Output, Program, Region, Type, Value
from .prune import prune

Values = np.ndarray
"""An array of `Value`s, with dtype object."""

COMMUTATIVE = frozenset({"add", "mul", "min", "max", "and", "or", "xor", "eq", "ne"})
COMPARISONS = frozenset({"eq", "ne", "lt", "le", "gt", "ge", "isfinite"})


LARGEST = 4_000_000
"""As many values as a program may have; at some 250 bytes each they take 1 GB."""

LARGEST_CODE = 400_000
"""As many of them may be operations; LLVM takes a minute and 2 GB for so many."""


class Builder:
    """A program in the making.

    A value is made once: asked for again, in the same region or in one inside of it, it is found again. In a loop it is
    placed outside if nothing that it needs changes there; out of a branch nothing is moved, as it may be expensive.

    - `origin`: put on every value made from now on.
    """

    def __init__(self) -> None:
        self.program = Program()
        self.region = self.program.body
        self.origin: Any = None
        self._count = 0
        self._operations = 0

    # ---- numbers ----------------------------------------------------------------------------------------------------

    def constant(self, number: Number, type: Type) -> Value:
        """A known number.

        - `number`: Python's or NumPy's.
        - `type`: of the value.
        """
        if type in FLOATS:
            number = float(np.float32(number)) if type == "f32" else float(number)
            key: Any = number.hex()
        else:
            number = bool(number) if type == "b1" else int(number)
            key = number
        return self._known(self.program.body, ("const", type, key), "const", type, (), number)

    def input(self, name: str, type: Type, shape: tuple[int, ...], *, varying: bool = False) -> Values:
        """A new input, as an array of its elements.

        - `name`, `type`, `shape`: its own.
        - `varying`: whether each run of a batch has its own.
        """
        which = len(self.program.inputs)
        self.program.inputs.append(Input(name, type, shape, varying))
        array = np.empty(self.program.inputs[-1].size, object)
        for k in range(array.size):
            array[k] = self._new(self.program.body, "input", type, (), (which, k))
        return array.reshape(shape)

    def output(self, name: str, type: Type, values: Values) -> None:
        """Declares what the program returns.

        - `name`, `type`: its own.
        - `values`: the array.
        """
        self.program.outputs.append(Output(name, type, values.shape, tuple(values.ravel())))

    def logged(self, name: str, type: Type, shape: tuple[int, ...]) -> int:
        """Declares an output that is written row by row; returns its number, for `store`.

        - `name`, `type`: its own.
        - `shape`: of one row.
        """
        self.program.outputs.append(Output(name, type, shape, None))
        return len(self.program.outputs) - 1

    def store(self, output: int, row: Value, when: Value, values: Values) -> None:
        """Writes one row of a logged output.

        - `output`: from `logged`.
        - `row`: its number, i64.
        - `when`: b1; nothing is written where it is false.
        - `values`: the row.
        """
        self._new(self.region, "store", "none", (row, when, *values.ravel()), output)

    # ---- operations -------------------------------------------------------------------------------------------------

    def apply(self, op: str, *args: Value, type: Type | None = None, data: Any = None) -> Value:
        """The value of an operation, simplified.

        - `op`, `args`, `data`: see `slidax.codegen.ir`.
        - `type`: of the result; None: that of the last argument, or b1 for comparisons.
        """
        if type is None:
            type = "b1" if op in COMPARISONS else args[-1].type
        if op in COMMUTATIVE and args[0].number > args[1].number:
            args = (args[1], args[0])
        simpler = folded(self, op, type, args)
        if simpler is not None:
            return simpler
        region = self._place(args)
        key = (op, type, data, *[arg.number for arg in args])
        return self._known(region, key, op, type, args, data)

    def loop(
        self,
        carried: Sequence[Value],
        condition: Callable[[tuple[Value, ...]], Value],
        body: Callable[[tuple[Value, ...]], Sequence[Value]],
        turns: Value | None = None,
    ) -> list[Value]:
        """`while condition(carried): carried = body(carried)`; returns the carried numbers after it.

        - `carried`: the numbers before the first turn.
        - `condition`: makes a b1 of the carried numbers.
        - `body`: makes their successors, of the same types.
        - `turns`: the number of turns if it is known; the first of the carried numbers must then count them from 0.
        """
        head = Region("head", self.region)
        loop = Loop("loop", "none", tuple(carried), None, self.region, self._next(), self.origin)
        loop.head, loop.body, loop.turns = head, Region("body", head), turns
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
        """What `then()` makes where `when` is true, else what `otherwise()` makes; only one of them is computed.

        - `when`: b1.
        - `then`, `otherwise`: make numbers, as many and of the same types.
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
        # What both leave is no matter of the branch.
        return [yes if yes is no else result for yes, no, result in zip(block.yes, block.no, results, strict=True)]

    def call(self, program: Program, args: Sequence[Value]) -> list[Value]:
        """The elements of a function's outputs, one output after the other.

        - `program`: the function; it logs nothing.
        - `args`: the elements of its inputs, one input after the other.
        """
        region = self._place(tuple(args))
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
        """The program, without what nothing needs."""
        prune(self.program)
        return self.program

    # ---- inside -----------------------------------------------------------------------------------------------------

    def _decided(self, when: Value) -> bool | None:
        """What a condition is here, if a branch around has asked it already."""
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
                f"programs of more than {LARGEST_CODE} operations or {LARGEST} numbers; arrays are taken apart into "
                "their numbers, and this has too many"
            )
        value = Value(op, type, args, data, region, self._next(), self.origin)
        region.values.append(value)
        return value

    def _known(self, region: Region, key: Any, op: str, type: Type, args: tuple[Value, ...], data: Any) -> Value:
        around: Region | None = region
        while around is not None:
            found = around.known.get(key)
            if found is not None:
                return found
            around = around.parent
        value = self._new(region, op, type, args, data)
        region.known[key] = value
        return value

    def _place(self, args: tuple[Value, ...]) -> Region:
        region = self.region
        while region.kind in ("head", "body"):
            # What a body computes from the carried numbers alone stays in it: the head runs once more than the body.
            head = region.parent if region.kind == "body" else region
            assert head is not None
            assert head.parent is not None
            for arg in args:
                if arg.region is region or arg.region is head:
                    return region
            region = head.parent
        return region

    def _results(self, block: Value, like: Sequence[Value]) -> list[Value]:
        # They come from where the block does, not from where its last value does.
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
        raise TypeError(f"{[v.type for v in before]} became {[v.type for v in after]}")
