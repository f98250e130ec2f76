"""Print loops, branches and their values as the body of one LLVM function.

The function computes several runs of the program in parallel, one per lane (element) of the CPU's vectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..builder import Builder
from ..ir import ELEMENTARY, Branch, Loop, Program, Region, Type, Value
from . import memory
from .operations import TYPES, Lines, literal, operation, type_name
from .vectorise import Vector, lower_and_fuse


@dataclass(frozen=True)
class ElementaryFunction:
    """An elementary function of scalars or vectors, as a function in LLVM IR.

    - `op`: its IR operation, such as "sin".
    - `type`: type of the arguments and the result.
    - `arguments`: number of arguments.
    - `width`: number of lanes; 1 for scalars.
    """

    op: str
    type: Type
    arguments: int
    width: int

    @property
    def head(self) -> str:
        """Result type and name in LLVM IR."""
        return f"{type_name(self.type, self.width)} @own_{self.op}_{self.type}_{self.width}"

    @property
    def program(self) -> Program:
        """A program that computes the function by correctly rounded operations."""
        builder = Builder()
        arguments = [builder.input(f"x{k}", self.type, (), varying=True).item() for k in range(self.arguments)]
        builder.output("y", self.type, np.array(builder.apply(self.op, *arguments, type=self.type), object))
        return lower_and_fuse(builder.finish())

    def call(self, words: list[str]) -> str:
        """Return a call of the function in LLVM IR; `words` are its arguments, as LLVM operands."""
        llvm_type = type_name(self.type, self.width)
        return f"call {self.head}({', '.join(f'{llvm_type} {word}' for word in words)})"


def varying_values(program: Program) -> set[Value]:
    """Return all values that may differ between runs, since they depend on an input that varies.

    A value that a loop changes also differs if the number of iterations differs. The values are determined in passes
    over the program: a value counts as equal in all runs until a pass shows otherwise.
    """
    differing: set[Value] = set()
    count = -1
    while len(differing) > count:
        count = len(differing)
        _visit(program, program.body, differing)
    return differing


def _visit(program: Program, region: Region, differing: set[Value]) -> None:
    for value in region.values:
        if isinstance(value, Loop):
            _visit_loop(program, value, differing)
        elif isinstance(value, Branch):
            _visit(program, value.then, differing)
            _visit(program, value.otherwise, differing)
        elif value not in differing and _differs(program, value, differing):
            differing.add(value)


def _visit_loop(program: Program, loop: Loop, differing: set[Value]) -> None:
    for param, first, next in zip(loop.params, loop.args, loop.following, strict=True):
        # Runs that have left the loop keep their values, while others still change them.
        if first in differing or next in differing or (loop.condition in differing and next is not param):
            differing.add(param)
    _visit(program, loop.head, differing)
    _visit(program, loop.body, differing)


def _differs(program: Program, value: Value, differing: set[Value]) -> bool:
    if value.op == "input":
        return bool(program.inputs[value.data[0]].varying)
    if value.op == "result":
        block = value.args[0]
        if isinstance(block, Loop):
            return block.params[value.data] in differing
        assert isinstance(block, Branch)
        return any(leaf in differing for leaf in (block.args[0], block.yes[value.data], block.no[value.data]))
    if value.op == "load" and program.inputs[value.data].varying:
        return True
    return any(arg in differing for arg in value.args)


EXPENSIVE = frozenset({*ELEMENTARY, "load", "store", "loop", "branch", "div", "rem", "sqrt"})
SELECT_LIMIT = 12
"""Largest number of operations in a branch that is replaced by a selection; none of them is `EXPENSIVE`."""


class Blocks(Lines):
    """Writer of one function in LLVM IR: prints a program's operations, loops and branches to `lines`.

    - `lanes`: number of runs that are computed in parallel.
    - `called`: elementary functions that the function calls.
    """

    def __init__(self, program: Program, lanes: int) -> None:
        super().__init__()
        self.program = program
        self.lanes = lanes
        self.called: set[ElementaryFunction] = set()
        self._differs = varying_values(program) if lanes > 1 else set()
        self._names: dict[Value, str] = {}
        self._spread: list[dict[Value, str]] = [{}]  # vectors of uniform values, by open region
        self._label, self._mask = "entry", ""  # the mask: the active lanes; "" for all

    def print(self) -> None:
        """Write the complete body, which reads and writes the program's inputs and outputs in memory."""
        memory.load_addresses(self.program, self)
        memory.allocate_spare(self.program, self.lanes, self)
        self._region(self.program.body)
        for index, output in enumerate(self.program.outputs):
            for element, value in enumerate(output.values or ()):
                word = self._word(value, self.lanes)
                memory.write_output(self.program, index, element, word, self.lanes, self)
        self.write("ret void")

    def print_function(self, llvm_type: str) -> None:
        """Write the body of a function of the program's inputs `%x0`, `%x1`, ... that returns its first output.

        - `llvm_type`: type of the function's result.
        """
        self._names = {value: f"%x{value.data[0]}" for value in self.program.walk() if value.op == "input"}
        self._region(self.program.body)
        for result in self.program.outputs[0].values or ():
            self.write(f"ret {llvm_type} {self._word(result, self.lanes)}")

    # ---- words ------------------------------------------------------------------------------------------------------

    def _width(self, value: Value) -> int:
        """Return the number of lanes of a value."""
        if isinstance(value, Vector):
            return value.lanes
        return self.lanes if value in self._differs else 1

    def _own(self, value: Value) -> str:
        if value.op == "const":
            return literal(value.data, value.type)
        return self._names.get(value) or f"%v{value.number}"

    def _word(self, value: Value, width: int) -> str:
        """Return the LLVM operand for a value with `width` lanes, broadcast if necessary."""
        if width == self._width(value):
            return self._own(value)
        if value.op == "const":
            return literal(value.data, value.type, width)
        if name := next((words[value] for words in reversed(self._spread) if value in words), ""):
            return name
        name = f"%s{value.number}x{len(self.lines)}"
        self._broadcast(name, value.type, self._own(value), width)
        self._spread[-1][value] = name
        return name

    def _words(self, values: Sequence[Value], widths: Sequence[int]) -> list[str]:
        return [self._word(value, width) for value, width in zip(values, widths, strict=True)]

    def _any(self, mask: str, name: str) -> str:
        self.write(f"{name}b = bitcast <{self.lanes} x i1> {mask} to i{self.lanes}")
        self.write(f"{name} = icmp ne i{self.lanes} {name}b, 0")
        return name

    def _active_lanes(self, mask: str, name: str) -> str:
        """Return the mask, restricted to the active lanes."""
        if not self._mask:
            return mask
        self.write(f"{name} = and <{self.lanes} x i1> {self._mask}, {mask}")
        return name

    def _open(self, label: str) -> None:
        self.write(f"{label}:")
        self._label = label

    # ---- values -----------------------------------------------------------------------------------------------------

    def _region(self, region: Region) -> None:
        for value in region.values:
            self._value(value)

    def _value(self, value: Value) -> None:
        op = value.op
        if op == "const" or op == "param" or value in self._names:
            return
        if isinstance(value, Loop):
            self._loop(value)
        elif isinstance(value, Branch):
            self._branch(value)
        elif op == "result":
            block = value.args[0]
            self._names[value] = (
                self._own(block.params[value.data]) if isinstance(block, Loop) else f"%v{block.number}r{value.data}"
            )
        elif op == "store":
            self._store(value)
        elif op in ("input", "load"):
            self._read(value)
        elif op in ("pick", "gather", "spread"):
            self._rearrange(value)
        else:
            width = self._width(value)
            words = [self._word(arg, width) for arg in value.args]
            if op in ELEMENTARY:
                self.called.add(function := ElementaryFunction(op, value.type, len(value.args), width))
                self.write(f"%v{value.number} = {function.call(words)}")
            else:
                operation(value, words, width, self)

    def _broadcast(self, name: str, type: Type, word: str, lanes: int) -> None:
        llvm_type = type_name(type, lanes)
        self.write(f"{name}i = insertelement {llvm_type} poison, {TYPES[type]} {word}, i32 0")
        self.write(f"{name} = shufflevector {llvm_type} {name}i, {llvm_type} poison, <{lanes} x i32> zeroinitializer")

    def _rearrange(self, value: Value) -> None:
        name, words = f"%v{value.number}", [self._own(arg) for arg in value.args]
        if not isinstance(value, Vector):
            vector = type_name(value.type, self._width(value.args[0]))
            self.write(f"{name} = extractelement {vector} {words[0]}, i32 {value.data}")
        elif value.op == "spread":
            self._broadcast(name, value.type, words[0], value.lanes)
        else:
            before = "poison"
            for k, word in enumerate(words):
                after = name if k == len(words) - 1 else f"{name}g{k}"
                number = f"{TYPES[value.type]} {word}, i32 {k}"
                self.write(f"{after} = insertelement {type_name(value.type, len(words))} {before}, {number}")
                before = after

    def _read(self, value: Value) -> None:
        if isinstance(value, Vector):
            return memory.read_vector(value, value.lanes, self)
        wide = value.op == "load" and value.args[0] in self._differs
        index = self._own(value.args[0]) if value.op == "load" else str(value.data[1])
        memory.read(self.program, value, index, self._width(value), wide, self._mask, self)

    def _store(self, value: Value) -> None:
        row, when, *numbers = value.args
        name = f"%v{value.number}"
        certain = when.op == "const" and when.data
        mask = self._mask
        if not certain:
            if when in self._differs:
                mask = self._active_lanes(self._word(when, self.lanes), f"{name}m")
                condition = self._any(mask, f"{name}y")
            else:
                condition = self._own(when)
            self.write(f"br i1 {condition}, label %write{value.number}, label %after{value.number}")
            self._open(f"write{value.number}")
        self._spread.append({})
        words = [self._word(number, self.lanes) for number in numbers]
        rows = [self._own(row)] * self.lanes
        if row in self._differs:
            rows = [f"{name}p{lane}" for lane in range(self.lanes)]
            for lane, number in enumerate(rows):
                self.write(f"{number} = extractelement <{self.lanes} x i64> {self._own(row)}, i32 {lane}")
        memory.write_row(self.program, value, rows, mask, words, self.lanes, self)
        self._spread.pop()
        if not certain:
            self.write(f"br label %after{value.number}")
            self._open(f"after{value.number}")

    # ---- blocks -----------------------------------------------------------------------------------------------------

    def _loop(self, loop: Loop) -> None:
        n, around = loop.number, self._mask
        widths = [self._width(param) for param in loop.params]
        first, before = self._words(loop.args, widths), self._label
        self.write(f"br label %head{n}")
        self._open(f"head{n}")
        line = len(self.lines)
        self.lines += [""] * len(loop.params)  # for the phis, whose arguments are known at the end
        self._spread.append({})
        self._region(loop.head)
        condition = self._own(loop.condition)
        if loop.condition in self._differs:
            self._mask = self._active_lanes(condition, f"%v{n}m")
            condition = self._any(self._mask, f"%v{n}y")
        self.write(f"br i1 {condition}, label %body{n}, label %after{n}")
        self._open(f"body{n}")
        self._spread.append({})
        self._region(loop.body)
        following = self._words(loop.following, widths)
        if loop.condition in self._differs:
            for k, param in enumerate(loop.params):
                if param in self._differs and loop.following[k] is not param:
                    llvm_type, held = type_name(param.type, self.lanes), f"%v{n}h{k}"
                    mask = f"<{self.lanes} x i1> {self._mask}"
                    self.write(f"{held} = select {mask}, {llvm_type} {following[k]}, {llvm_type} %v{param.number}")
                    following[k] = held
        self.write(f"br label %head{n}")
        for k, param in enumerate(loop.params):
            phi = (
                f"phi {type_name(param.type, widths[k])} [ {first[k]}, %{before} ], [ {following[k]}, %{self._label} ]"
            )
            self.lines[line + k] = f"%v{param.number} = {phi}"
        self._spread[-2:] = []
        self._mask = around
        self._open(f"after{n}")

    def _branch(self, branch: Branch) -> None:
        n, when = branch.number, branch.args[0]
        divergent = when in self._differs
        widths = [
            self.lanes if divergent or yes in self._differs or no in self._differs else 1
            for yes, no in zip(branch.yes, branch.no, strict=True)
        ]
        if is_cheap(branch):
            self._region(branch.then)
            self._region(branch.otherwise)
            self._select(branch, widths)
        elif divergent:
            mask, around = self._own(when), self._mask
            self.write(f"%v{n}n = xor <{self.lanes} x i1> {mask}, {literal(1, 'b1', self.lanes)}")
            then = self._side(branch.then, branch.yes, mask, f"{n}t")
            self._mask = around
            otherwise = self._side(branch.otherwise, branch.no, f"%v{n}n", f"{n}e")
            self._mask = around
            self._select(branch, widths, then, otherwise)
        else:
            self.write(f"br i1 {self._own(when)}, label %then{n}, label %else{n}")
            then, then_end = self._jump_to_side(branch.then, branch.yes, widths, f"then{n}", f"after{n}")
            otherwise, else_end = self._jump_to_side(branch.otherwise, branch.no, widths, f"else{n}", f"after{n}")
            self._open(f"after{n}")
            for k, value in enumerate(branch.yes):
                phi = f"[ {then[k]}, %{then_end} ], [ {otherwise[k]}, %{else_end} ]"
                self.write(f"%v{n}r{k} = phi {type_name(value.type, widths[k])} {phi}")

    def _jump_to_side(
        self, region: Region, leaves: Sequence[Value], widths: Sequence[int], label: str, after: str
    ) -> tuple[list[str], str]:
        """Write one side of a branch; return its values and its last label."""
        self._open(label)
        self._spread.append({})
        self._region(region)
        words = self._words(leaves, widths)
        self._spread.pop()
        self.write(f"br label %{after}")
        return words, self._label

    def _side(self, region: Region, leaves: Sequence[Value], mask: str, name: str) -> list[str]:
        """Write one side of a divergent branch, skipped if no run takes it; return its values."""
        if not region.values:
            return [self._word(value, self.lanes) for value in leaves]
        self._mask = self._active_lanes(mask, f"%v{name}m")
        condition, before = self._any(self._mask, f"%v{name}y"), self._label
        self.write(f"br i1 {condition}, label %side{name}, label %after{name}")
        words, end = self._jump_to_side(region, leaves, [self.lanes] * len(leaves), f"side{name}", f"after{name}")
        self._open(f"after{name}")
        for k, value in enumerate(leaves):
            # Not poison: a later branch may depend on the values of inactive lanes.
            phi = f"[ {words[k]}, %{end} ], [ zeroinitializer, %{before} ]"
            self.write(f"%v{name}{k} = phi {type_name(value.type, self.lanes)} {phi}")
            words[k] = f"%v{name}{k}"
        return words

    def _select(
        self, branch: Branch, widths: Sequence[int], then: Sequence[str] = (), otherwise: Sequence[str] = ()
    ) -> None:
        when = branch.args[0]
        then = then or self._words(branch.yes, widths)
        otherwise = otherwise or self._words(branch.no, widths)
        for k, value in enumerate(branch.yes):
            llvm_type = type_name(value.type, widths[k])
            # A scalar condition also selects between vectors.
            mask = type_name("b1", self._width(when))
            chosen = f"{llvm_type} {then[k]}, {llvm_type} {otherwise[k]}"
            self.write(f"%v{branch.number}r{k} = select {mask} {self._own(when)}, {chosen}")


def is_cheap(branch: Branch) -> bool:
    """True if both sides of a branch cost less than a mispredicted jump."""
    values = [*branch.then.values, *branch.otherwise.values]
    return len(values) <= SELECT_LIMIT and not any(value.op in EXPENSIVE for value in values)
