"""Calls of functions as C statements."""

from __future__ import annotations

import re
from abc import ABC
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..ir import Call, Input, Program, Value
from .expressions import CExpression
from .layout import INDENT, WIDTH
from .writer import Writer


class Callee(NamedTuple):
    """A C function, called as `name(shared..., inputs..., results)`.

    - `shared`: arguments that are the same in all calls.
    - `passed`: numbers of the inputs that each call passes, as arrays.
    """

    name: str
    shared: tuple[str, ...]
    passed: tuple[int, ...]


Callees = Callable[[Program], Callee]


class CallWriter(Writer, ABC):
    """Write calls."""

    callees: Callees | None = None

    def call(self, call: Call) -> None:
        """Write an array for the results, and the call that fills it."""
        assert self.callees is not None
        self.called.append(call.program)
        callee = self.callees(call.program)
        place, arguments = 0, list(callee.shared)
        for k, entry in enumerate(call.program.inputs):
            if k in callee.passed:
                elements = call.args[place : place + entry.size]
                arguments.append(self._array(entry, elements, callee) if entry.shape else self.texts[elements[0]].text)
            place += entry.size
        size = sum(output.size for output in call.program.outputs)
        name = self.new_name(self._hint_of(call) or f"{callee.name}_result")
        self.line(f"{self.dialect.type('f64')} {name}[{size}];", call)
        self.bytes += size * self.dialect.size("f64")
        self.line(f"{callee.name}({', '.join((*arguments, name))});", call)
        for k, result in self.placement.results_of(call).items():
            self.texts[result] = CExpression(f"{name}[{k}]")

    def _hint_of(self, call: Call) -> str | None:
        """Name of the results in the source, without a number."""
        for result in self.placement.results_of(call).values():
            hint = self.hint(result)
            if hint is not None:
                return hint.rstrip("0123456789").rstrip("_") or None
        return None

    def _array(self, entry: Input, elements: Sequence[Value], callee: Callee) -> str:
        """Array of values: in place if they lie there in order, else a new one."""
        texts = [self.places.get(value, self.texts[value].text) for value in elements]
        first = re.fullmatch(r"(.*)\[(\d+)\]", texts[0])
        if first is not None:
            array, start = first.group(1), int(first.group(2))
            if all(text == f"{array}[{start + k}]" for k, text in enumerate(texts)):
                return f"&{array}[{start}]" if start else array
        name = self.new_name(f"{callee.name}_at")
        self.bytes += entry.size * self.dialect.size(entry.type)
        self.line(f"const {self.dialect.type(entry.type)} {name}[{entry.size}] = {{")
        room = WIDTH - len(INDENT) * (self.level + 1)
        row = ""
        for text in [f"{self.texts[value].text}," for value in elements]:
            if row and len(row) + 1 + len(text) > room:
                self.line(INDENT + row)
                row = ""
            row = f"{row} {text}" if row else text
        self.line(INDENT + row.rstrip(","))
        self.line("};")
        return name
