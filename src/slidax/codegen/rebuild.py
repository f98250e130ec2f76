"""Copy a program value by value and replace some of them; blocks stay as they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .builder import Builder
from .ir import Branch, Call, Loop, Output, Program, Region, Value

Replace = Callable[[Builder, Value, tuple[Value, ...]], Value | None]
"""From the builder, a value of the old program and its new arguments to the new value; None copies the value."""


def rebuild(program: Program, replace: Replace) -> Program:
    """Return a program with some values replaced, simplified again, without unused values.

    The functions that it calls are copied as well.

    - `replace`: called for each value that is neither a constant, an input, a store nor part of a block.
    """
    return Rebuilding(program, replace, {}).finish()


class Rebuilding:
    """State of a copy.

    - `program`, `replace`: see `rebuild`.
    - `functions`: new functions, by the `id` of the old ones.
    """

    def __init__(self, program: Program, replace: Replace, functions: dict[int, Program]) -> None:
        self.old = program
        self.replace = replace
        self.functions = functions
        self.builder = Builder()
        self.new_values: dict[Value, Value] = {}
        self.left: dict[Value, Sequence[Value]] = {}  # results of each block
        self.inputs = [
            self.builder.input(entry.name, entry.type, entry.shape, varying=entry.varying).ravel()
            for entry in program.inputs
        ]

    def finish(self) -> Program:
        """Return the new program."""
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

        turns = None if loop.turns is None else self.new_values[loop.turns]
        self.left[loop] = self.builder.loop(self._all(loop.args), condition, body, turns)

    def _branch(self, branch: Branch) -> None:
        def side(region: Region, leaves: Sequence[Value]) -> Callable[[], Sequence[Value]]:
            def make() -> Sequence[Value]:
                self._region(region)
                return self._all(leaves)

            return make

        self.left[branch] = self.builder.branch(
            self.new_values[branch.args[0]], side(branch.then, branch.yes), side(branch.otherwise, branch.no)
        )
