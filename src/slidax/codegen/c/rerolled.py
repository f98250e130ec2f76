"""Statements that are alike for all joints, as loops over arrays.

What the trace has taken apart into its numbers is put together again at the end: statements of one operation on an
array that differ in nothing but the elements that they take become the turns of a loop, and what they compute an array.
No operation is added, left out or reordered within an expression, so that nothing changes in the numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from .alike import LEAST, Access, parsed
from .arrays import Arrays
from .assignments import Run, in_runs
from .groups import Group, Statement, goes_on, ordered
from .helpers import Helpers
from .in_place import passed_in_place
from .layout import Line
from .reduced import reduced

Local = dict[Access, str]
"""Numbers that live for a turn, by where they would lie, with their names."""

DECLARED = re.compile(r"(const )?(double|float|bool|u?int(?:32|64)_t) (\w+)(?: = (.*))?;")
ASSIGNED = re.compile(r"([A-Za-z_]\w*(?:->\w+)?(?:\[\d+\])?) = (.*);")


def rerolled(lines: Sequence[Line], taken: set[str], helpers: Helpers) -> list[Line]:
    """The lines with loops in them.

    - `lines`: of a function.
    - `taken`: names that are not free.
    - `helpers`: takes what they call.
    """
    return _Rerolling(lines, taken, helpers).run()


class _Rerolling:
    def __init__(self, lines: Sequence[Line], taken: set[str], helpers: Helpers) -> None:
        self.lines = lines
        self.helpers = helpers
        self.out: list[Line] = []
        self.used: Counter[str] = Counter()
        self.declared: set[str] = set()
        for line in lines:
            match = DECLARED.fullmatch(line.text)
            text = line.text if match is None else match.group(4) or ""
            self.used.update(parsed(text).operands)
        identifiers = {word for line in lines for word in re.findall(r"[A-Za-z_]\w*", line.text)} | taken
        self.index = next(name for name in ("i", "j", "k", "m", "n", "turn") if name not in identifiers)
        self.arrays = Arrays(identifiers)

    def run(self) -> list[Line]:
        """All lines."""
        k = 0
        while k < len(self.lines):
            end, kind = self._run_of(k)
            if kind == "known":
                self._known(k, end)
            elif kind == "mutable":
                self._mutable(k, end)
            elif kind == "assigned":
                self._assigned(k, end)
            else:
                self.out.append(self.lines[k])
            k = end
        renamed = [Line(line.level, self._renamed(line.text), line.about) for line in self.out]
        return reduced(passed_in_place(renamed), self.arrays.named, self.index, self.helpers)

    def _run_of(self, k: int) -> tuple[int, str]:
        """Where the lines of one kind that begin here end, and their kind."""
        kind, level = _kind(self.lines[k]), self.lines[k].level
        end = k + 1
        if kind:
            while end < len(self.lines) and self.lines[end].level == level and _kind(self.lines[end]) == kind:
                end += 1
        return end, kind

    def _renamed(self, text: str) -> str:
        return parsed(text).written(lambda word: self.arrays.where(word))

    # ---- numbers that are computed once -----------------------------------------------------------------------------

    def _known(self, first: int, end: int) -> None:
        """Declarations of constants, in an order in which what is alike stands together."""
        statements = []
        for k in range(first, end):
            match = DECLARED.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(Statement(self.lines[k], k, match.group(2), match.group(3), match.group(4)))
        self._print(ordered(self.arrays.grouped(statements)), self.lines[first].level)

    def _print(self, order: list[Group], level: int) -> None:
        k = 0
        while k < len(order):
            group = order[k]
            if group.target is None:
                one = group.lanes[0]
                if group.array:
                    self._declare(one.type, group.array, level, one.line)
                    text = f"{group.array}[{self.arrays.stored[one.name][1]}] = {one.piece.text};"
                    self.out.append(Line(level, text, one.line.about))
                else:
                    self.out.append(one.line)
                k += 1
                continue
            together = [group]
            while k + len(together) < len(order) and goes_on(order[k + len(together)], together):
                together.append(order[k + len(together)])
            self._loop(together, level)
            k += len(together)

    def _declare(self, type: str, array: str, level: int, line: Line) -> None:
        """Declares an array, unless that was done."""
        if array not in self.declared:
            self.declared.add(array)
            size = 1 + max(at for name, at in self.arrays.stored.values() if name == array)
            self.out.append(Line(level, f"{type} {array}[{size}];", line.about))

    def _loop(self, groups: list[Group], level: int) -> None:
        """Writes groups of as many lanes as the turns of one loop."""
        inside: Counter[str] = Counter(word for group in groups for one in group.lanes for word in one.piece.operands)
        local: Local = {}
        for group in groups:
            if (
                group.lanes[0].line.element is None
                and not group.looks_back
                and all(inside[one.name] == self.used[one.name] for one in group.lanes)
            ):
                assert group.target is not None
                whole = len(group.lanes) == sum(array == group.array for array, _ in self.arrays.stored.values())
                local[group.target] = group.array if whole else self.arrays.named(group.lanes[0].name)
        body: list[Line] = []
        about = groups[0].lanes[0].line.about
        for group in groups:
            one = group.lanes[0]
            texts = [self._operand(access, local, level, one) for access in group.at]
            text = one.piece.filled(texts)
            assert group.target is not None
            if group.target in local:
                body.append(Line(level + 1, f"const {one.type} {local[group.target]} = {text};"))
            else:
                self._declare(one.type, group.array, level, one.line)
                body.append(Line(level + 1, f"{group.target.element(self.index)} = {text};"))
        self._turns(groups[0].turns, body, level, about)

    def _turns(self, turns: int, body: list[Line], level: int, about: str) -> None:
        self.out.append(Line(level, f"for (size_t {self.index} = 0; {self.index} < {turns}; ++{self.index}) {{", about))
        self.out += body
        self.out.append(Line(level, "}", about))

    def _operand(self, access: Access, local: Local, level: int, one: Statement) -> str:
        if access.numbers:
            name = self.arrays.named("table")
            numbers = ", ".join(access.numbers)
            self.out.append(Line(level, f"static const {one.type} {name}[{len(access.numbers)}] = {{{numbers}}};"))
            return f"{name}[{self.index}]"
        if not access.step:
            return self.arrays.where(access.text)
        return local[access] if access in local else access.element(self.index)

    # ---- numbers that change ----------------------------------------------------------------------------------------

    def _mutable(self, first: int, end: int) -> None:
        """Declarations of variables: those with one stem become an array."""
        k = first
        while k < end:
            stem = _stem(self.lines[k])
            last = k + 1
            while last < end and _stem(self.lines[last]) == stem:
                last += 1
            if last - k < LEAST:
                self.out += self.lines[k:last]
            else:
                self._array_of_variables(k, last)
            k = last

    def _array_of_variables(self, first: int, end: int) -> None:
        matches = [DECLARED.fullmatch(self.lines[k].text) for k in range(first, end)]
        found = [match for match in matches if match is not None]
        line, type = self.lines[first], found[0].group(2)
        array = self.arrays.named(found[0].group(3))
        for k, match in enumerate(found):
            self.arrays.stored[match.group(3)] = (array, k)
        self.out.append(Line(line.level, f"{type} {array}[{end - first}];", line.about))
        starts = [
            Statement(self.lines[first + k], first + k, "", f"{array}[{k}]", match.group(4))
            for k, match in enumerate(found)
            if match.group(4) is not None
        ]
        self._print_assigned(starts, line.level)

    def _assigned(self, first: int, end: int) -> None:
        statements = []
        for k in range(first, end):
            match = ASSIGNED.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(Statement(self.lines[k], k, "", match.group(1), match.group(2)))
        self._print_assigned(statements, self.lines[first].level)

    def _print_assigned(self, statements: list[Statement], level: int) -> None:
        """Assignments, in an order that leaves each the same."""
        for run in in_runs(statements, self.arrays.stored, self.arrays.where):
            one = run.lanes[0]
            about = one.line.about
            if not run.at:
                self.out.append(Line(level, f"{one.name} = {one.piece.text};", about))
            elif run.at_once:
                self.out.append(Line(level, self._moved(run), about))
            else:
                texts = [self._operand(access, {}, level, _typed(one)) for access in run.at[1:]]
                body = [Line(level + 1, f"{run.at[0].element(self.index)} = {one.piece.filled(texts)};")]
                self._turns(len(run.lanes), body, level, about)

    def _moved(self, run: Run) -> str:
        """Moves a part of an array to another one, or makes it zero."""
        target, given = run.at
        arrays = (target.array, given.array) if given.step else (target.array,)
        size = f"{len(run.lanes)} * sizeof {min(arrays, key=len)}[0]"
        if given.step:
            return f"memcpy({target.pointer()}, {given.pointer()}, {size});"
        return f"memset({target.pointer()}, 0, {size});"


def _typed(one: Statement) -> Statement:
    one.type = one.type or ("float" if re.search(r"\d[\d.e-]*f\b", one.piece.text) else "double")
    return one


def _kind(line: Line) -> str:
    match = DECLARED.fullmatch(line.text)
    if match is not None:
        return "known" if match.group(1) else "mutable"
    return "assigned" if ASSIGNED.fullmatch(line.text) else ""


def _stem(line: Line) -> tuple[str, str]:
    match = DECLARED.fullmatch(line.text)
    assert match is not None
    return match.group(2), re.sub(r"(_?\d+[a-z]*|_[a-z]{1,2})$", "", match.group(3))
