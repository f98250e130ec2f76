"""Write values, calls, loops and branches of a program as C statements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..ir import Branch, Call, Input, Loop, Program, Region, Value
from ..naming.names import Names, identifier
from .expressions import CHOICE, EITHER, UNARY, CExpression, Dialect, Expressions, Helpers, constant
from .layout import INDENT, WIDTH, CodeLine, pointer_to
from .placement import Placement, is_counter, is_counter_increment

Read = Callable[[int, int | str], str]
"""Map the indices of an input and of its element to the C text that reads it. The second may be a C expression."""

Rows = Callable[[int, str, int], str]
"""Map an output's index, the C expression of a row and an element's index to the C lvalue of the element."""

LETTERS = [first + second for first in ["", *"bcdefghijklmnopqrstuvwxyz"] for second in "bcdefghijklmnopqrstuvwxyz"]
"""Suffixes that make a name unique."""

HEAVY = 7
"""Largest number of operations in a line."""


class Callee(NamedTuple):
    """C function of a called program. A call is written as `name(shared..., inputs..., results)`.

    - `shared`: C text of the arguments that are equal in all calls.
    - `passed`: indices of those inputs of the program that are arguments of the C function.
    """

    name: str
    shared: tuple[str, ...]
    passed: tuple[int, ...]


Callees = Callable[[Program], Callee]


@dataclass(eq=False)
class Writer:
    """Writer of one C function: appends the C lines of values, loops and branches to `lines`.

    - `placement`: the values to compute, with the region and order in which to compute them.
    - `names`: preferred names and comments of values.
    - `read`, `precomputed`, `taken`, `rows`, `callees`, `loops`: as in `statements`.
    """

    placement: Placement
    dialect: Dialect
    read: Read
    precomputed: Mapping[Value, str]
    names: Names
    taken: set[str]
    rows: Rows | None = None
    callees: Callees | None = None
    loops: bool = False

    def __post_init__(self) -> None:
        self.helpers = Helpers(self.dialect)
        self.expressions = Expressions(self.dialect, self.helpers, ordered_operands=self.loops)
        self.lines: list[CodeLine] = []
        self.texts: dict[Value, CExpression] = {}
        self.reads: set[int] = set()
        self.input_places: dict[Value, str] = {}
        # Values that are elements of an array: the array's number and the index.
        self.array_elements: dict[Value, tuple[int, int]] = {}
        self.called: list[Program] = []
        self.level = 1
        # Variables of outer blocks that inner blocks assign directly.
        self.result_names: dict[Value, str] = {}
        self._unnamed = 0

    # ---- lines ------------------------------------------------------------------------------------------------------

    def line(self, text: str, value: Value | None = None) -> None:
        """Append a line of C at the current indentation.

        - `value`: the value that the line computes, for the comment; None for other lines.
        """
        if value is None:
            self.lines.append(CodeLine(self.level, text))
        else:
            visit = getattr(value.origin, "visit", None)
            self.lines.append(
                CodeLine(self.level, text, self.names.about(value), visit, self.array_elements.get(value))
            )

    def new_name(self, hint: str | None) -> str:
        """Return an unused name that begins with the hint; without a hint, `v1`, `v2` and so on."""
        if hint is None:
            self._unnamed += 1
            hint = f"v{self._unnamed}"
        name, letters = hint, iter(LETTERS)
        while name in self.taken:
            name = f"{hint}{'' if hint[-1].isdigit() else '_'}{next(letters)}"
        self.taken.add(name)
        return name

    def new_variable(self, value: Value, hint: str | None = None) -> tuple[str, str]:
        """Return the C type and an unused name of a new variable for a value; `hint` is the preferred name."""
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

    def declare_value(self, value: Value, hint: str | None = None) -> None:
        """Declare a C variable that holds an already composed value; later uses of the value read the variable."""
        written = self.texts[value]
        type, name = self.new_variable(value, hint)
        self.line(f"const {type} {name} = {written.text};", value)
        self.texts[value] = CExpression(name)

    def max_length(self) -> int:
        """Return the largest length of an expression at the current indentation [characters]."""
        return WIDTH - len(INDENT) * self.level - len("const double name_12 = ;")

    def _value(self, value: Value) -> None:
        if value.op == "const":
            self.texts[value] = constant(value.data, value.type, self.dialect)
            return
        if value.op == "input":
            which, element = value.data
            text = self.read(which, element)
            self.reads.add(which)
            self.input_places[value] = text
            self.texts[value] = CExpression(text, reads=frozenset((text,)))
            # A loop over an array reads its elements in place.
            if self.placement.uses[value] > 1 and not text.isidentifier() and not (self.loops and text[-1] == "]"):
                self.declare_value(value)
            return
        self.texts[value] = self._compose(value)
        if not self._is_cheap(value) and not self.is_inline(value):
            self.declare_value(value)

    def _compose(self, value: Value) -> CExpression:
        """Return the expression of a value; declare variables for operands that make it too long."""
        args = list(dict.fromkeys(value.args))
        while True:
            written = self._operation(value)
            # Conditions on all elements of an array later become a loop, which is short.
            if self.loops and value.type == "b1" and value.op in ("and", "or"):
                return written
            heaviest = max(args, key=lambda arg: self.texts[arg].weight, default=None)
            if heaviest is None or self.texts[heaviest].weight == 0:
                return written
            if written.weight <= HEAVY and len(written.text) <= self.max_length():
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
        """True if a value's expression is written at its use, without a variable."""
        name = self.names.of(value)
        if value in self.array_elements:
            return False
        return self.placement.has_single_use(value) and (
            value in self.placement.assigned or name is None or not name.firm
        )

    def _is_cheap(self, value: Value) -> bool:
        """True if a value's expression is about as short as a name."""
        if value in self.array_elements:
            return False
        arg = self.texts[value.args[0]]
        return arg.weight == 0 and (self.texts[value].text == arg.text or value.op in ("neg", "not"))

    # ---- assignments ------------------------------------------------------------------------------------------------

    def assign(self, pairs: Sequence[tuple[str, Value]]) -> None:
        """Write simultaneous assignments: none reads a value that another has overwritten.

        - `pairs`: C lvalues, and the values that they get.
        """
        waiting = [
            (target, value)
            for target, value in pairs
            if target not in (self.texts[value].text, self.input_places.get(value))
        ]
        while waiting:
            for pair in waiting:
                if not any(pair[0] in self.texts[value].reads for target, value in waiting if target != pair[0]):
                    break
            else:
                # A copy breaks the cycle.
                pair = waiting[0]
                self.declare_value(pair[1])
                continue
            waiting.remove(pair)
            self.line(f"{pair[0]} = {self.texts[pair[1]].text};")

    def store(self, store: Value) -> None:
        """Write the assignments to one row of a log."""
        assert self.rows is not None
        row, when, *values = store.args
        if self.texts[row].weight > 1 and len(values) > 1:
            self.declare_value(row)
        always = self.texts[when].text == "true"
        if not always:
            self.line(f"if ({self.texts[when].text}) {{")
            self.level += 1
        for k, value in enumerate(values):
            self.line(f"{self.rows(store.data, self.texts[row].text, k)} = {self.texts[value].text};")
        if not always:
            self.level -= 1
            self.line("}")

    # ---- calls ------------------------------------------------------------------------------------------------------

    def call(self, call: Call) -> None:
        """Declare an array for the results, and write the call that fills it."""
        assert self.callees is not None
        self.called.append(call.program)
        callee = self.callees(call.program)
        start, arguments = 0, list(callee.shared)
        for k, entry in enumerate(call.program.inputs):
            if k in callee.passed:
                elements = call.args[start : start + entry.size]
                arguments.append(self._array(entry, elements, callee) if entry.shape else self.texts[elements[0]].text)
            start += entry.size
        size = sum(output.size for output in call.program.outputs)
        name = self.new_name(self._hint_of(call) or f"{callee.name}_result")
        self.line(f"{self.dialect.type('f64')} {name}[{size}];", call)
        self.line(f"{callee.name}({', '.join((*arguments, name))});", call)
        for k, result in self.placement.results_of(call).items():
            self.texts[result] = CExpression(f"{name}[{k}]")

    def _hint_of(self, call: Call) -> str | None:
        """Return the name of the results in the source, without a number."""
        for result in self.placement.results_of(call).values():
            hint = self.hint(result)
            if hint is not None:
                stem = hint.rstrip("0123456789").rstrip("_")
                return identifier(stem) if stem else None
        return None

    def _array(self, entry: Input, elements: Sequence[Value], callee: Callee) -> str:
        """Return an array of values: a part of an existing one if they are contiguous there, else a new one."""
        pointer = pointer_to([self.input_places.get(value, self.texts[value].text) for value in elements])
        if pointer is not None:
            return pointer
        name = self.new_name(f"{callee.name}_at")
        self.line(f"const {self.dialect.type(entry.type)} {name}[{entry.size}] = {{")
        width = WIDTH - len(INDENT) * (self.level + 1)
        row = ""
        for text in [f"{self.texts[value].text}," for value in elements]:
            if row and len(row) + 1 + len(text) > width:
                self.line(INDENT + row)
                row = ""
            row = f"{row} {text}" if row else text
        self.line(INDENT + row.rstrip(","))
        self.line("};")
        return name

    # ---- branches ---------------------------------------------------------------------------------------------------

    def branch(self, branch: Branch) -> None:
        """Write an `if`, or a conditional expression if both sides are short."""
        left = self.placement.results_of(branch)
        hints = {k: self._hint(branch, k) for k in left}
        into = {k: self.result_names.pop(result, None) for k, result in left.items()}
        names = {k: into[k] or self.new_name(hints[k]) for k in left}
        when, sides = branch.args[0], [(branch.then, branch.yes), (branch.otherwise, branch.no)]
        if when.op == "not":
            when, sides = when.args[0], sides[::-1]
        condition = self.texts[when]
        then, otherwise = [self._side(region, {leaves[k]: names[k] for k in left}) for region, leaves in sides]
        yes, no = [{k: leaves[k] for k in left} for _, leaves in sides]
        if len(left) == 1 and not then and not otherwise:
            ((k, result),) = left.items()
            choice = self._choice(condition, self.texts[yes[k]], self.texts[no[k]])
            if choice is not None:
                self.texts[result] = choice
                if into[k] is None:
                    self.taken.discard(names[k])
                    if not self.is_inline(result):
                        self.declare_value(result, hints[k])
                return
        # A variable that is initialised with the value of the `else` side needs no `else`.
        plain = not otherwise and not any(into.values()) and not any(self.texts[value].weight for value in no.values())
        for k, result in left.items():
            if into[k] is None:
                start = f" = {self.texts[no[k]].text}" if plain else ""
                self.line(f"{self.dialect.type(result.type)} {names[k]}{start};", result)
            self.texts[result] = CExpression(names[k])
        self.line(f"if ({condition.text}) {{")
        self._leave(then, [(names[k], value) for k, value in yes.items()])
        if not plain:
            self.line("} else {")
            self._leave(otherwise, [(names[k], value) for k, value in no.items()])
        self.line("}")

    def _choice(self, when: CExpression, yes: CExpression, no: CExpression) -> CExpression | None:
        """Return a conditional expression; None if it is too long to read."""
        text = f"{when.within(EITHER)} ? {yes.within(EITHER)} : {no.within(CHOICE)}"
        weight = 1 + when.weight + yes.weight + no.weight
        if weight > HEAVY or len(text) > self.max_length():
            return None
        return CExpression(text, CHOICE, weight, when.reads | yes.reads | no.reads)

    def _hint(self, branch: Branch, k: int) -> str | None:
        for value in (self.placement.results_of(branch)[k], branch.yes[k], branch.no[k]):
            if value.op not in ("const", "input") and value.region.within(branch.region):
                name = self.hint(value)
                if name is not None:
                    return name
        return None

    def _side(self, region: Region, leaves: Mapping[Value, str]) -> list[CodeLine]:
        """Return the lines of one side; inner blocks assign the results of this side directly."""
        around, self.lines = self.lines, []
        self.level += 1
        for value, name in leaves.items():
            if value.op == "result" and self.placement.has_single_use(value) and value not in self.precomputed:
                self.result_names[value] = name
        self.region(region)
        self.level -= 1
        side, self.lines = self.lines, around
        return side

    def _leave(self, lines: list[CodeLine], pairs: list[tuple[str, Value]]) -> None:
        self.lines += lines
        self.level += 1
        self.assign(pairs)
        self.level -= 1

    # ---- loops ------------------------------------------------------------------------------------------------------

    def loop(self, loop: Loop) -> None:
        """Write a loop: a `for` if the number of iterations is known at its start, else a `while`."""
        left = self.placement.results_of(loop)
        names: dict[int, str] = {}
        counted = self._counter(loop, left) if loop.iterations is not None else ""
        for k in self.placement.carried(loop):
            param = loop.params[k]
            if is_counter(param):
                continue
            names[k] = self._carried(loop, k, left)
            self.texts[param] = CExpression(names[k], reads=frozenset((names[k],)))
        head, condition = self._head(loop)
        if counted:
            self.line(counted)
        elif head:
            self.line("for (;;) {")
        else:
            self.line(f"while ({condition}) {{")
        self.lines += head
        self.level += 1
        if head and not counted:
            self.line(f"if ({condition}) {{")
            self.lines.append(CodeLine(self.level + 1, "break;"))
            self.line("}")
        self.region(loop.body)
        self.assign([(names[k], loop.following[k]) for k in names])
        self.level -= 1
        self.line("}")
        for k, result in left.items():
            self.texts[result] = CExpression(names[k] if k in names else self.texts[loop.params[0]].text)

    def _counter(self, loop: Loop, left: Mapping[int, Value]) -> str:
        """Return the head of a `for`."""
        assert loop.iterations is not None
        if self.texts[loop.iterations].weight:
            self.declare_value(loop.iterations)
        param = loop.params[0]
        type, name = self.new_variable(param, self._index())
        self.texts[param] = CExpression(name, reads=frozenset((name,)))
        start = f"{type} {name} = 0"
        if 0 in left:
            self.line(start + ";")
            start = ""
        return f"for ({start}; {name} < {self.texts[loop.iterations].text}; ++{name}) {{"

    def _index(self) -> str:
        return next((name for name in "ijkmn" if name not in self.taken), "i")

    def _carried(self, loop: Loop, k: int, left: Mapping[int, Value]) -> str:
        """Declare a carried variable with its initial value."""
        result, param = left.get(k), loop.params[k]
        name = self.result_names.pop(result, None) if result is not None else None
        start = self.texts[loop.args[k]].text
        if name is not None:
            self.line(f"{name} = {start};")
            return name
        alike = [param, loop.following[k]] if result is None else [result, param, loop.following[k]]
        hint = next((self.hint(value) for value in alike if self.hint(value) is not None), None)
        type, name = self.new_variable(param, hint)
        self.line(f"{type} {name} = {start};", param)
        return name

    def _head(self, loop: Loop) -> tuple[list[CodeLine], str]:
        """Return the lines at the start of an iteration, and the condition to stop after them.

        Without lines, the condition is the one to continue; for a known number of iterations, it is empty.
        """
        around, self.lines = self.lines, []
        self.level += 1
        self.region(loop.head)
        self.level -= 1
        head, self.lines = self.lines, around
        if loop.iterations is not None:
            return head, ""
        condition = self.texts[loop.condition]
        return head, f"!{condition.within(UNARY)}" if head else condition.text
