"""Values as C statements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

from ..ir import Branch, Call, Loop, Program, Region, Value
from ..naming import Names
from .dialect import Dialect
from .expressions import CExpression, Expressions, constant
from .helpers import Helpers
from .layout import INDENT, WIDTH, CodeLine
from .placement import Placement, is_counter_increment

Read = Callable[[int, int | str], str]
"""From an input's number and an element, as a number or a C expression, to the C text that reads it."""

Rows = Callable[[int, str, int], str]
"""From an output's number, the expression of a row and an element's number to the C text of its place."""

LETTERS = [first + second for first in ["", *"bcdefghijklmnopqrstuvwxyz"] for second in "bcdefghijklmnopqrstuvwxyz"]
"""Suffixes that make a name unique."""

HEAVY = 7
"""Largest number of operations in a line."""


class Writer(ABC):
    """Write the values of one function, without blocks.

    - `read`: C text that reads an element of an input.
    - `precomputed`: C text that reads a value without computing it.
    - `names`: preferred names and comments of values.
    - `taken`: names in use.
    """

    def __init__(
        self,
        placement: Placement,
        dialect: Dialect,
        read: Read,
        precomputed: Mapping[Value, str],
        names: Names,
        taken: set[str],
    ) -> None:
        self.placement = placement
        self.dialect = dialect
        self.read = read
        self.precomputed = precomputed
        self.names = names
        self.taken = taken
        self.helpers = Helpers(dialect)
        self.expressions = Expressions(dialect, self.helpers)
        self.lines: list[CodeLine] = []
        self.texts: dict[Value, CExpression] = {}
        self.reads: set[int] = set()
        self.places: dict[Value, str] = {}  # of inputs
        self.loops = False
        # Values that are elements of an array: the array's number and the index.
        self.array_elements: dict[Value, tuple[int, int]] = {}
        self.called: list[Program] = []
        self.bytes = 0
        self.level = 1
        # Variables for results of inner blocks that get none of their own.
        self.result_names: dict[Value, str] = {}
        self._unnamed = 0

    # ---- lines ------------------------------------------------------------------------------------------------------

    def line(self, text: str, value: Value | None = None) -> None:
        """Write a line, without indentation, that computes a value."""
        if value is None:
            self.lines.append(CodeLine(self.level, text))
        else:
            visit = getattr(value.origin, "visit", None)
            self.lines.append(
                CodeLine(self.level, text, self.names.about(value), visit, self.array_elements.get(value))
            )

    def new_name(self, hint: str | None) -> str:
        """Return an unused name; without a hint, a short one with a number."""
        if hint is None:
            self._unnamed += 1
            hint = f"v{self._unnamed}"
        name, letters = hint, iter(LETTERS)
        while name in self.taken:
            name = f"{hint}{'' if hint[-1].isdigit() else '_'}{next(letters)}"
        self.taken.add(name)
        return name

    def new_variable(self, value: Value, hint: str | None = None) -> tuple[str, str]:
        """Return type and name of a new variable for a value, and count its bytes."""
        self.bytes += self.dialect.size(value.type)
        return self.dialect.type(value.type), self.new_name(hint or self.hint(value))

    def hint(self, value: Value) -> str | None:
        """Return the preferred name of a value, or None."""
        name = self.names.of(value)
        return None if name is None else name.text

    # ---- values -----------------------------------------------------------------------------------------------------

    def region(self, region: Region) -> None:
        """Write all values that are placed in a region."""
        for value in self.placement.order[region]:
            if value in self.precomputed:
                self.texts[value] = CExpression(self.precomputed[value], reads=frozenset((self.precomputed[value],)))
            elif isinstance(value, Loop):
                self.loop(value)
            elif isinstance(value, Branch):
                self.branch(value)
            elif isinstance(value, Call):
                self.call(value)
            elif value.op == "store":
                self.store(value)
            elif value.op != "result":
                self._value(value)

    @abstractmethod
    def loop(self, loop: Loop) -> None:
        """Write a loop."""

    @abstractmethod
    def branch(self, branch: Branch) -> None:
        """Write a branch."""

    @abstractmethod
    def store(self, store: Value) -> None:
        """Write the assignments to a row of a logged output."""

    @abstractmethod
    def call(self, call: Call) -> None:
        """Write a call."""

    def declare_value(self, value: Value, hint: str | None = None) -> None:
        """Give a value with an expression a variable of its own."""
        written = self.texts[value]
        type, name = self.new_variable(value, hint)
        self.line(f"const {type} {name} = {written.text};", value)
        self.texts[value] = CExpression(name)

    def room(self) -> int:
        """Return the largest number of characters in an expression."""
        return WIDTH - len(INDENT) * self.level - len("const double name_12 = ;")

    def _value(self, value: Value) -> None:
        if value.op == "const":
            self.texts[value] = constant(value.data, value.type, self.dialect)
            return
        if value.op == "input":
            which, element = value.data
            text = self.read(which, element)
            self.reads.add(which)
            self.places[value] = text
            self.texts[value] = CExpression(text, reads=frozenset((text,)))
            # A loop over an array reads its elements in place.
            if self.placement.uses[value] > 1 and not text.isidentifier() and not (self.loops and text[-1] == "]"):
                self.declare_value(value)
            return
        self.texts[value] = self._composed(value)
        if not self._is_cheap(value) and not self.is_inline(value):
            self.declare_value(value)

    def _composed(self, value: Value) -> CExpression:
        """Expression of a value; operands that make it too long or too heavy get variables of their own."""
        args = list(dict.fromkeys(value.args))
        while True:
            written = self._operation(value)
            # Conditions on all elements of arrays become loops, and are then short.
            if self.loops and value.type == "b1" and value.op in ("and", "or"):
                return written
            heaviest = max(args, key=lambda arg: self.texts[arg].weight, default=None)
            if heaviest is None or self.texts[heaviest].weight == 0:
                return written
            if written.weight <= HEAVY and len(written.text) <= self.room():
                return written
            self.declare_value(heaviest)

    def _operation(self, value: Value) -> CExpression:
        args = [self.texts[arg] for arg in value.args]
        if value.op == "load":
            self.reads.add(value.data)
            text = self.read(value.data, args[0].text)
            return CExpression(text, weight=1 + args[0].weight, reads=args[0].reads | {text})
        cannot_overflow = is_counter_increment(value)
        return self.expressions.operation(
            value.op, value.type, value.args[-1].type, args, cannot_overflow=cannot_overflow
        )

    def is_inline(self, value: Value) -> bool:
        """True if a value is written in place of its use, and not as a variable."""
        name = self.names.of(value)
        if value in self.array_elements:
            return False
        return self.placement.has_single_use(value) and (
            value in self.placement.assigned or name is None or not name.firm
        )

    def _is_cheap(self, value: Value) -> bool:
        """True if a value's expression is no longer than a name."""
        if value in self.array_elements:
            return False
        arg = self.texts[value.args[0]]
        return arg.weight == 0 and (self.texts[value].text == arg.text or value.op in ("neg", "not"))
