"""Values as C statements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

from ..ir import Branch, Call, Loop, Program, Region, Value
from ..naming import Names
from .dialect import Dialect
from .expressions import Expressions, Written, constant
from .helpers import Helpers
from .layout import INDENT, WIDTH, Line
from .placement import Placement, counts_by_little

Read = Callable[[int, int | str], str]
"""From an input's number and the number of an element, known or an expression, to how that element is read."""

Rows = Callable[[int, str, int], str]
"""From an output's number, the expression of a row and the number of an element, to where that element is written."""

LETTERS = [first + second for first in ["", *"bcdefghijklmnopqrstuvwxyz"] for second in "bcdefghijklmnopqrstuvwxyz"]
"""What is put behind a name that is taken."""

HEAVY = 7
"""Operations that a line may hold."""


class Writer(ABC):
    """Writes the values of one function, without blocks.

    - `placement`: which values, and where.
    - `dialect`: how types and numbers are written.
    - `read`: how inputs are read.
    - `given`: how values that are known already are read.
    - `names`: preferred names of values, and what comments say of them.
    - `taken`: names that are not free.
    """

    def __init__(
        self,
        placement: Placement,
        dialect: Dialect,
        read: Read,
        given: Mapping[Value, str],
        names: Names,
        taken: set[str],
    ) -> None:
        self.placement = placement
        self.dialect = dialect
        self.read = read
        self.given = given
        self.names = names
        self.taken = taken
        self.helpers = Helpers(dialect)
        self.expressions = Expressions(dialect, self.helpers)
        self.lines: list[Line] = []
        self.texts: dict[Value, Written] = {}
        self.reads: set[int] = set()
        self.places: dict[Value, str] = {}  # of inputs
        self.loops = False
        # Values that are elements of an array, each with the number of the array and its place there.
        self.together: dict[Value, tuple[int, int]] = {}
        self.called: list[Program] = []
        self.bytes = 0
        self.level = 1
        # Where the results of inner blocks go, if not to variables of their own.
        self.into: dict[Value, str] = {}
        self._unnamed = 0

    # ---- lines ------------------------------------------------------------------------------------------------------

    def line(self, text: str, value: Value | None = None) -> None:
        """Writes a line.

        - `text`: without its indentation.
        - `value`: what it computes, if anything.
        """
        if value is None:
            self.lines.append(Line(self.level, text))
        else:
            visit = getattr(value.origin, "visit", None)
            self.lines.append(Line(self.level, text, self.names.about(value), visit, self.together.get(value)))

    def fresh(self, hint: str | None) -> str:
        """A name that nothing has yet.

        - `hint`: what it should be; None: a short one with a number.
        """
        if hint is None:
            self._unnamed += 1
            hint = f"v{self._unnamed}"
        name, letters = hint, iter(LETTERS)
        while name in self.taken:
            name = f"{hint}{'' if hint[-1].isdigit() else '_'}{next(letters)}"
        self.taken.add(name)
        return name

    def declared(self, value: Value, hint: str | None = None) -> tuple[str, str]:
        """A new variable's type and name; counts its bytes.

        - `value`: that it is to hold.
        - `hint`: a name that would fit.
        """
        self.bytes += self.dialect.size(value.type)
        return self.dialect.type(value.type), self.fresh(hint or self.hint(value))

    def hint(self, value: Value) -> str | None:
        """The preferred name of a value; None if it has none.

        - `value`: any.
        """
        name = self.names.of(value)
        return None if name is None else name.text

    # ---- values -----------------------------------------------------------------------------------------------------

    def region(self, region: Region) -> None:
        """Writes all that is placed in a region.

        - `region`: the region.
        """
        for value in self.placement.order[region]:
            if value in self.given:
                self.texts[value] = Written(self.given[value], reads=frozenset((self.given[value],)))
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
        """Writes a loop.

        - `loop`: the loop.
        """

    @abstractmethod
    def branch(self, branch: Branch) -> None:
        """Writes a branch.

        - `branch`: the branch.
        """

    @abstractmethod
    def store(self, store: Value) -> None:
        """Writes the assignments to a row of a logged output.

        - `store`: the store.
        """

    @abstractmethod
    def call(self, call: Call) -> None:
        """Writes a call.

        - `call`: the call.
        """

    def keep(self, value: Value, hint: str | None = None) -> None:
        """Gives a value a name in a statement of its own.

        - `value`: one whose expression is known.
        - `hint`: a name that would fit.
        """
        written = self.texts[value]
        type, name = self.declared(value, hint)
        self.line(f"const {type} {name} = {written.text};", value)
        self.texts[value] = Written(name)

    def room(self) -> int:
        """How many characters an expression may have."""
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
            self.texts[value] = Written(text, reads=frozenset((text,)))
            # A loop over an array finds its elements where they are.
            if self.placement.uses[value] > 1 and not text.isidentifier() and not (self.loops and text[-1] == "]"):
                self.keep(value)
            return
        self.texts[value] = self._composed(value)
        if not self._is_cheap(value) and not self.is_inline(value):
            self.keep(value)

    def _composed(self, value: Value) -> Written:
        """The expression of a value; operands that make it too long or too heavy get statements of their own."""
        args = list(dict.fromkeys(value.args))
        while True:
            written = self._operation(value)
            # What asks the same of all elements of arrays becomes loops, and is then short.
            if self.loops and value.type == "b1" and value.op in ("and", "or"):
                return written
            heaviest = max(args, key=lambda arg: self.texts[arg].weight, default=None)
            if heaviest is None or self.texts[heaviest].weight == 0:
                return written
            if written.weight <= HEAVY and len(written.text) <= self.room():
                return written
            self.keep(heaviest)

    def _operation(self, value: Value) -> Written:
        args = [self.texts[arg] for arg in value.args]
        if value.op == "load":
            self.reads.add(value.data)
            text = self.read(value.data, args[0].text)
            return Written(text, weight=1 + args[0].weight, reads=args[0].reads | {text})
        counts = counts_by_little(value)
        return self.expressions.operation(value.op, value.type, value.args[-1].type, args, counts=counts)

    def is_inline(self, value: Value) -> bool:
        """Whether a value is written where it is used, and not in a statement of its own.

        - `value`: any.
        """
        name = self.names.of(value)
        if value in self.together:
            return False
        return self.placement.alone(value) and (value in self.placement.assigned or name is None or not name.firm)

    def _is_cheap(self, value: Value) -> bool:
        """Whether a value's expression is no longer than a name would be."""
        if value in self.together:
            return False
        arg = self.texts[value.args[0]]
        return arg.weight == 0 and (self.texts[value].text == arg.text or value.op in ("neg", "not"))
