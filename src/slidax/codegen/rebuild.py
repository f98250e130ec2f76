"""Copies a program value by value, so that some values can be replaced; blocks stay as they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .builder import Builder
from .ir import Branch, Call, Loop, Output, Program, Region, Value

Replace = Callable[[Builder, Value, tuple[Value, ...]], Value | None]
"""From the builder, a value of the old program and its arguments in the new one, to the new value; None: the same."""


def rebuild(program: Program, replace: Replace) -> Program:
    """The same program with some of its values replaced, simplified anew and without what is then not needed.

    - `program`: stays as it is, and so do the functions that it calls: what is made calls new ones.
    - `replace`: is asked about each value that is neither a constant, an input, a store nor part of a block.
    """
    return Rebuilding(program, replace, {}).finish()


class Rebuilding:
    """What has been made so far.

    - `program`, `replace`: see `rebuild`.
    - `functions`: those made already, by the old ones.
    """

    def __init__(self, program: Program, replace: Replace, functions: dict[int, Program]) -> None:
        self.old = program
        self.replace = replace
        self.functions = functions
        self.builder = Builder()
        self.made: dict[Value, Value] = {}
        self.left: dict[Value, Sequence[Value]] = {}  # by each block
        self.inputs = [
            self.builder.input(entry.name, entry.type, entry.shape, varying=entry.varying).ravel()
            for entry in program.inputs
        ]

    def finish(self) -> Program:
        """The new program."""
        outputs = self.builder.program.outputs
        # Stores know outputs by number, so each takes its old place before what it holds is known.
        outputs += [Output(old.name, old.type, old.shape, None) for old in self.old.outputs]
        self._region(self.old.body)
        for new, old in zip(outputs, self.old.outputs, strict=True):
            new.values = None if old.values is None else self._all(old.values)
        self.builder.program.name = self.old.name
        self.builder.program.arrays = [
            tuple(self.made[value] for value in array)
            for array in self.old.arrays
            if all(value in self.made for value in array)
        ]
        return self.builder.finish()

    def _function(self, program: Program) -> Program:
        if id(program) not in self.functions:
            self.functions[id(program)] = Rebuilding(program, self.replace, self.functions).finish()
        return self.functions[id(program)]

    def _all(self, values: Sequence[Value]) -> tuple[Value, ...]:
        made = self.made
        return tuple([made[value] for value in values])

    def _region(self, region: Region) -> None:
        builder, made, replace = self.builder, self.made, self.replace
        for value in region.values:
            op = value.op
            builder.origin = value.origin
            if op == "const":
                made[value] = builder.constant(value.data, value.type)
            elif op == "input":
                made[value] = self.inputs[value.data[0]][value.data[1]]
            elif op == "result":
                made[value] = self.left[value.args[0]][value.data]
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
                args = tuple([made[arg] for arg in value.args])
                new = replace(builder, value, args)
                made[value] = builder.apply(op, *args, type=value.type, data=value.data) if new is None else new

    def _loop(self, loop: Loop) -> None:
        def condition(carried: tuple[Value, ...]) -> Value:
            self.made.update(zip(loop.params, carried, strict=True))
            self._region(loop.head)
            return self.made[loop.condition]

        def body(_: tuple[Value, ...]) -> Sequence[Value]:
            self._region(loop.body)
            return self._all(loop.following)

        turns = None if loop.turns is None else self.made[loop.turns]
        self.left[loop] = self.builder.loop(self._all(loop.args), condition, body, turns)

    def _branch(self, branch: Branch) -> None:
        def side(region: Region, leaves: Sequence[Value]) -> Callable[[], Sequence[Value]]:
            def make() -> Sequence[Value]:
                self._region(region)
                return self._all(leaves)

            return make

        self.left[branch] = self.builder.branch(
            self.made[branch.args[0]], side(branch.then, branch.yes), side(branch.otherwise, branch.no)
        )
