"""Passes over programs: copy with replaced values, fuse multiply-adds, bound the number of operations in a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from .builder import Builder
from .ir import ELEMENTARY, FLOATS, Branch, Call, Loop, Output, Program, Region, Value

Replace = Callable[[Builder, Value, tuple[Value, ...]], Value | None]
"""Map the builder, a value of the old program and its new arguments to the new value; None copies the value."""


def rebuild(program: Program, replace: Replace) -> Program:
    """Return a simplified copy of a program in which some values are replaced and unused values are removed.

    The programs that it calls are copied as well.

    - `replace`: function from the copy's builder, an old operation and its new arguments to the new value, or None to
      copy the operation. It is not called for constants, inputs, stores, loops, branches, calls and their results.
    """
    return Rebuilding(program, replace, {}).finish()


class Rebuilding:
    """State of `rebuild` while it copies a program.

    - `program`, `replace`: as in `rebuild`.
    - `functions`: copies of called programs, by the `id` of the original.
    """

    def __init__(self, program: Program, replace: Replace, functions: dict[int, Program]) -> None:
        self.old = program
        self.replace = replace
        self.functions = functions
        self.builder = Builder()
        self.new_values: dict[Value, Value] = {}
        self.left: dict[Value, Sequence[Value]] = {}  # results of each loop, branch and call
        self.inputs = [
            self.builder.input(entry.name, entry.type, entry.shape, varying=entry.varying).ravel()
            for entry in program.inputs
        ]

    def finish(self) -> Program:
        """Copy the program, and return the copy."""
        outputs = self.builder.program.outputs
        # Stores refer to outputs by number, so each output is added before its values are known.
        outputs += [Output(old.name, old.type, old.shape, None) for old in self.old.outputs]
        self._region(self.old.body)
        for new, old in zip(outputs, self.old.outputs, strict=True):
            new.values = None if old.values is None else self._all(old.values)
        self.builder.program.name = self.old.name
        self.builder.program.arrays = [
            tuple(self.new_values[value] for value in array)
            for array in self.old.arrays
            if all(value in self.new_values for value in array)
        ]
        return self.builder.finish()

    def _function(self, program: Program) -> Program:
        if id(program) not in self.functions:
            self.functions[id(program)] = Rebuilding(program, self.replace, self.functions).finish()
        return self.functions[id(program)]

    def _all(self, values: Sequence[Value]) -> tuple[Value, ...]:
        new_values = self.new_values
        return tuple([new_values[value] for value in values])

    def _region(self, region: Region) -> None:
        builder, new_values, replace = self.builder, self.new_values, self.replace
        for value in region.values:
            op = value.op
            builder.origin = value.origin
            if op == "const":
                new_values[value] = builder.constant(value.data, value.type)
            elif op == "input":
                new_values[value] = self.inputs[value.data[0]][value.data[1]]
            elif op == "result":
                new_values[value] = self.left[value.args[0]][value.data]
            elif op == "store":
                row, when, *values = self._all(value.args)
                builder.store(value.data, row, when, np.array(values, object))
            elif isinstance(value, Loop):
                self._loop(value)
            elif isinstance(value, Branch):
                self._branch(value)
            elif isinstance(value, Call):
                self.left[value] = builder.call(self._function(value.program), self._all(value.args))
            else:
                args = tuple([new_values[arg] for arg in value.args])
                new = replace(builder, value, args)
                new_values[value] = builder.apply(op, *args, type=value.type, data=value.data) if new is None else new

    def _loop(self, loop: Loop) -> None:
        def condition(carried: tuple[Value, ...]) -> Value:
            self.new_values.update(zip(loop.params, carried, strict=True))
            self._region(loop.head)
            return self.new_values[loop.condition]

        def body(_: tuple[Value, ...]) -> Sequence[Value]:
            self._region(loop.body)
            return self._all(loop.following)

        iterations = None if loop.iterations is None else self.new_values[loop.iterations]
        self.left[loop] = self.builder.loop(self._all(loop.args), condition, body, iterations)

    def _branch(self, branch: Branch) -> None:
        def side(region: Region, leaves: Sequence[Value]) -> Callable[[], Sequence[Value]]:
            def make() -> Sequence[Value]:
                self._region(region)
                return self._all(leaves)

            return make

        self.left[branch] = self.builder.branch(
            self.new_values[branch.args[0]], side(branch.then, branch.yes), side(branch.otherwise, branch.no)
        )


def fuse_products(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
    """Return a sum or difference with a product as one multiply-add, `a b + c` rounded once; None for other operations.

    This is a `replace` function for `rebuild`: `value` is an operation of the old program, `args` its new arguments.
    A product is fused only if it is in the same region as the sum. A product outside the sum's loop is computed only
    once anyway. Other uses of the product do not matter, so that logging does not change the rounding. If both operands
    are products, the later one is fused, so that all targets round equally.
    """
    if value.op not in ("add", "sub") or value.type not in FLOATS:
        return None
    # The sum usually waits for the later product.
    for k in sorted((0, 1), key=lambda k: -value.args[k].number):
        product = args[k]
        if product.op == "mul" and value.args[k].region is value.region:
            a, b = product.args
            c = args[1 - k]
            if value.op == "sub":
                if k == 0:
                    c = builder.apply("neg", c, type=value.type)
                else:
                    a = builder.apply("neg", a, type=value.type)
            return builder.apply("fma", a, b, c, type=value.type)
    return None


FREE = frozenset({"const", "input", "param", "result", "copy", "bitcast"})
"""Operations that cost nothing."""


class OperationCount(NamedTuple):
    """Upper bound of the number of operations in one run of a program.

    - `operations`: number of additions, products, comparisons, selections, elementary functions and so on.
    - `elementary`: number of elementary functions among them.
    """

    operations: int
    elementary: int

    def __str__(self) -> str:
        return f"{self.operations}, {self.elementary} of them elementary functions"

    def __add__(self, other: object) -> OperationCount:
        assert isinstance(other, OperationCount)
        return OperationCount(self.operations + other.operations, self.elementary + other.elementary)

    def times(self, iterations: int) -> OperationCount:
        """Return this count multiplied by a number of iterations."""
        return OperationCount(self.operations * iterations, self.elementary * iterations)


NO_OPERATIONS = OperationCount(0, 0)


def count_operations(program: Program) -> OperationCount | None:
    """Return an upper bound for a run: the most iterations of each loop, and the longest side of each branch.

    Returns None if a loop's number of iterations has no known bound.
    """
    return _of_region(program.body)


def count_iterations(loop: Loop) -> int | None:
    """Return the largest number of iterations of a loop that counts by one from a constant to a constant.

    Returns None for other loops.
    """
    bounds = [bound for condition in _all_of(loop.condition) if (bound := _count(loop, condition)) is not None]
    return min(bounds, default=None)


def _all_of(condition: Value) -> Iterator[Value]:
    """Yield the conditions that `condition` joins by `and`."""
    if condition.op == "and":
        for part in condition.args:
            yield from _all_of(part)
    else:
        yield condition


def _count(loop: Loop, condition: Value) -> int | None:
    if condition.op != "lt":
        return None
    counter, end = condition.args
    if counter not in loop.params or end.op != "const":
        return None
    k = loop.params.index(counter)
    start, following = loop.args[k], loop.following[k]
    by_one = following.op == "add" and any(
        previous is counter and step.op == "const" and step.data == 1
        for previous, step in (following.args, following.args[::-1])
    )
    if start.op != "const" or not by_one:
        return None
    return max(int(end.data) - int(start.data), 0)


def _of_region(region: Region) -> OperationCount | None:
    total = NO_OPERATIONS
    for value in region.values:
        count = _of_value(value)
        if count is None:
            return None
        total += count
    return total


def _of_value(value: Value) -> OperationCount | None:
    if value.op in FREE:
        return NO_OPERATIONS
    if isinstance(value, Call):
        return count_operations(value.program)
    if isinstance(value, Loop):
        most, head, body = count_iterations(value), _of_region(value.head), _of_region(value.body)
        if most is None or head is None or body is None:
            return None
        # The condition is evaluated once more than the body.
        return (head + body).times(most) + head
    if isinstance(value, Branch):
        then, otherwise = _of_region(value.then), _of_region(value.otherwise)
        if then is None or otherwise is None:
            return None
        # Each count has its own maximum: the side with more operations may have fewer elementary functions.
        return OperationCount(1, 0) + OperationCount(*map(max, then, otherwise))
    return OperationCount(1, int(value.op in ELEMENTARY))
