"""Loops, branches and assignments as C statements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..ir import Branch, Loop, Region, Value
from .calls import CallWriter
from .expressions import CHOICE, EITHER, UNARY, CExpression
from .layout import CodeLine
from .placement import is_counter
from .writer import HEAVY, Rows


class BlockWriter(CallWriter):
    """Write the values of one function, with its loops and branches."""

    rows: Rows | None = None

    def assign(self, pairs: Sequence[tuple[str, Value]]) -> None:
        """Write simultaneous assignments: none reads a value that another has overwritten.

        - `pairs`: targets and values.
        """
        waiting = [
            (target, value) for target, value in pairs if target not in (self.texts[value].text, self.places.get(value))
        ]
        while waiting:
            for pair in waiting:
                if not any(pair[0] in self.texts[value].reads for target, value in waiting if target != pair[0]):
                    break
            else:
                # Circular: a copy breaks the circle.
                pair = waiting[0]
                self.declare_value(pair[1])
                continue
            waiting.remove(pair)
            self.line(f"{pair[0]} = {self.texts[pair[1]].text};")

    def store(self, store: Value) -> None:
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

    # ---- branches ---------------------------------------------------------------------------------------------------

    def branch(self, branch: Branch) -> None:
        """Write an `if`, or a choice between two expressions where both sides are short."""
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
        # A variable that starts with a known number needs no `else`.
        plain = not otherwise and not any(into.values()) and not any(self.texts[value].weight for value in no.values())
        for k, result in left.items():
            if into[k] is None:
                start = f" = {self.texts[no[k]].text}" if plain else ""
                self.line(f"{self.dialect.type(result.type)} {names[k]}{start};", result)
                self.bytes += self.dialect.size(result.type)
            self.texts[result] = CExpression(names[k])
        self.line(f"if ({condition.text}) {{")
        self._leave(then, [(names[k], value) for k, value in yes.items()])
        if not plain:
            self.line("} else {")
            self._leave(otherwise, [(names[k], value) for k, value in no.items()])
        self.line("}")

    def _choice(self, when: CExpression, yes: CExpression, no: CExpression) -> CExpression | None:
        """Choice between expressions; None if it is too long to read."""
        text = f"{when.within(EITHER)} ? {yes.within(EITHER)} : {no.within(CHOICE)}"
        weight = 1 + when.weight + yes.weight + no.weight
        if weight > HEAVY or len(text) > self.room():
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
        """Lines of one side; inner blocks assign the results of this side directly."""
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
        """Write a `for` where the number of iterations is known, else a `while`."""
        left = self.placement.results_of(loop)
        names: dict[int, str] = {}
        counted = self._counter(loop, left) if loop.turns is not None else ""
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
        """Head of a `for`."""
        assert loop.turns is not None
        if self.texts[loop.turns].weight:
            self.declare_value(loop.turns)
        param = loop.params[0]
        type, name = self.new_variable(param, self._index())
        self.texts[param] = CExpression(name, reads=frozenset((name,)))
        start = f"{type} {name} = 0"
        if 0 in left:
            self.line(start + ";")
            start = ""
        return f"for ({start}; {name} < {self.texts[loop.turns].text}; ++{name}) {{"

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
        """Lines at the start of an iteration, and the condition to stop, or to continue if there are no such lines."""
        around, self.lines = self.lines, []
        self.level += 1
        self.region(loop.head)
        self.level -= 1
        head, self.lines = self.lines, around
        if loop.turns is not None:
            return head, ""
        condition = self.texts[loop.condition]
        return head, f"!{condition.within(UNARY)}" if head else condition.text
