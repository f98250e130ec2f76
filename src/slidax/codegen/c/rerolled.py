"""Similar statements for all joints, written as loops over arrays.

The tracer takes arrays apart into numbers, and this module puts them together again: statements of one array operation
that differ only in the elements that they read become the iterations of a loop, and their values an array. No operation
is added, removed or reordered within an expression, so that no number changes.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from .alike import LEAST, Access, parse
from .arrays import Arrays
from .assignments import AssignmentRun, runs_of
from .groups import Group, Statement, fits_loop, order_groups
from .helpers import Helpers
from .in_place import pass_in_place
from .layout import CodeLine
from .reduced import reduce_conditions

Local = dict[Access, str]
"""Name of each value that lives for one iteration, by its place."""

DECLARATION = re.compile(r"(const )?(double|float|bool|u?int(?:32|64)_t) (\w+)(?: = (.*))?;")
ASSIGNMENT = re.compile(r"([A-Za-z_]\w*(?:->\w+)?(?:\[\d+\])?) = (.*);")


def reroll(lines: Sequence[CodeLine], taken: set[str], helpers: Helpers) -> list[CodeLine]:
    """Return the lines of a function with loops.

    - `taken`: names in use.
    - `helpers`: collects the called functions.
    """
    return _Rerolling(lines, taken, helpers).run()


class _Rerolling:
    def __init__(self, lines: Sequence[CodeLine], taken: set[str], helpers: Helpers) -> None:
        self.lines = lines
        self.helpers = helpers
        self.out: list[CodeLine] = []
        self.used: Counter[str] = Counter()
        self.declared: set[str] = set()
        for line in lines:
            match = DECLARATION.fullmatch(line.text)
            text = line.text if match is None else match.group(4) or ""
            self.used.update(parse(text).operands)
        identifiers = {word for line in lines for word in re.findall(r"[A-Za-z_]\w*", line.text)} | taken
        self.index = next(name for name in ("i", "j", "k", "m", "n", "turn") if name not in identifiers)
        self.arrays = Arrays(identifiers)

    def run(self) -> list[CodeLine]:
        k = 0
        while k < len(self.lines):
            end, kind = self._run_of(k)
            if kind == "constant":
                self._constants(k, end)
            elif kind == "variable":
                self._variables(k, end)
            elif kind == "assignment":
                self._assignments(k, end)
            else:
                self.out.append(self.lines[k])
            k = end
        renamed = [CodeLine(line.level, self._with_arrays(line.text), line.about) for line in self.out]
        return reduce_conditions(pass_in_place(renamed), self.arrays.new_name, self.index, self.helpers)

    def _run_of(self, k: int) -> tuple[int, str]:
        """End and kind of the successive lines of one kind that begin here."""
        kind, level = _kind(self.lines[k]), self.lines[k].level
        end = k + 1
        if kind:
            while end < len(self.lines) and self.lines[end].level == level and _kind(self.lines[end]) == kind:
                end += 1
        return end, kind

    def _with_arrays(self, text: str) -> str:
        return parse(text).with_operands(lambda word: self.arrays.read(word))

    # ---- constants ---------------------------------------------------------------------------------------------------

    def _constants(self, first: int, end: int) -> None:
        """Print declarations of constants, similar ones next to each other."""
        statements = []
        for k in range(first, end):
            match = DECLARATION.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(Statement(self.lines[k], k, match.group(2), match.group(3), match.group(4)))
        self._print(order_groups(self.arrays.groups_of(statements)), self.lines[first].level)

    def _print(self, order: list[Group], level: int) -> None:
        k = 0
        while k < len(order):
            group = order[k]
            if group.target is None:
                lane = group.lanes[0]
                if group.array:
                    self._declare(lane.type, group.array, level, lane.line)
                    text = f"{group.array}[{self.arrays.stored[lane.name][1]}] = {lane.piece.text};"
                    self.out.append(CodeLine(level, text, lane.line.about))
                else:
                    self.out.append(lane.line)
                k += 1
                continue
            together = [group]
            while k + len(together) < len(order) and fits_loop(order[k + len(together)], together):
                together.append(order[k + len(together)])
            self._loop(together, level)
            k += len(together)

    def _declare(self, type: str, array: str, level: int, line: CodeLine) -> None:
        """Declare an array once."""
        if array not in self.declared:
            self.declared.add(array)
            size = 1 + max(at for name, at in self.arrays.stored.values() if name == array)
            self.out.append(CodeLine(level, f"{type} {array}[{size}];", line.about))

    def _loop(self, groups: list[Group], level: int) -> None:
        """Print groups as one loop."""
        inside: Counter[str] = Counter(word for group in groups for lane in group.lanes for word in lane.piece.operands)
        local: Local = {}
        for group in groups:
            if (
                group.lanes[0].line.element is None
                and not group.looks_back
                and all(inside[lane.name] == self.used[lane.name] for lane in group.lanes)
            ):
                assert group.target is not None
                whole = len(group.lanes) == sum(array == group.array for array, _ in self.arrays.stored.values())
                local[group.target] = group.array if whole else self.arrays.new_name(group.lanes[0].name)
        body: list[CodeLine] = []
        about = groups[0].lanes[0].line.about
        for group in groups:
            lane = group.lanes[0]
            texts = [self._operand(access, local, level, lane) for access in group.at]
            text = lane.piece.fill(texts)
            assert group.target is not None
            if group.target in local:
                body.append(CodeLine(level + 1, f"const {lane.type} {local[group.target]} = {text};"))
            else:
                self._declare(lane.type, group.array, level, lane.line)
                body.append(CodeLine(level + 1, f"{group.target.element(self.index)} = {text};"))
        self._print_loop(groups[0].turns, body, level, about)

    def _print_loop(self, turns: int, body: list[CodeLine], level: int, about: str) -> None:
        self.out.append(
            CodeLine(level, f"for (size_t {self.index} = 0; {self.index} < {turns}; ++{self.index}) {{", about)
        )
        self.out += body
        self.out.append(CodeLine(level, "}", about))

    def _operand(self, access: Access, local: Local, level: int, lane: Statement) -> str:
        if access.numbers:
            name = self.arrays.new_name("table")
            numbers = ", ".join(access.numbers)
            self.out.append(CodeLine(level, f"static const {lane.type} {name}[{len(access.numbers)}] = {{{numbers}}};"))
            return f"{name}[{self.index}]"
        if not access.step:
            return self.arrays.read(access.text)
        return local[access] if access in local else access.element(self.index)

    # ---- variables --------------------------------------------------------------------------------------------------

    def _variables(self, first: int, end: int) -> None:
        """Print declarations of variables; those with one stem become an array."""
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
        matches = [DECLARATION.fullmatch(self.lines[k].text) for k in range(first, end)]
        variables = [match for match in matches if match is not None]
        line, type = self.lines[first], variables[0].group(2)
        array = self.arrays.new_name(variables[0].group(3))
        for k, match in enumerate(variables):
            self.arrays.stored[match.group(3)] = (array, k)
        self.out.append(CodeLine(line.level, f"{type} {array}[{end - first}];", line.about))
        starts = [
            Statement(self.lines[first + k], first + k, "", f"{array}[{k}]", match.group(4))
            for k, match in enumerate(variables)
            if match.group(4) is not None
        ]
        self._print_assignments(starts, line.level)

    def _assignments(self, first: int, end: int) -> None:
        statements = []
        for k in range(first, end):
            match = ASSIGNMENT.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(Statement(self.lines[k], k, "", match.group(1), match.group(2)))
        self._print_assignments(statements, self.lines[first].level)

    def _print_assignments(self, statements: list[Statement], level: int) -> None:
        """Print assignments in an order that keeps the value of each."""
        for run in runs_of(statements, self.arrays.stored, self.arrays.read):
            lane = run.lanes[0]
            about = lane.line.about
            if not run.at:
                self.out.append(CodeLine(level, f"{lane.name} = {lane.piece.text};", about))
            elif run.is_block_move:
                self.out.append(CodeLine(level, self._block_move(run), about))
            else:
                texts = [self._operand(access, {}, level, _with_type(lane)) for access in run.at[1:]]
                body = [CodeLine(level + 1, f"{run.at[0].element(self.index)} = {lane.piece.fill(texts)};")]
                self._print_loop(len(run.lanes), body, level, about)

    def _block_move(self, run: AssignmentRun) -> str:
        """Copy of a part of an array to another one, or to zero."""
        target, source = run.at
        arrays = (target.array, source.array) if source.step else (target.array,)
        size = f"{len(run.lanes)} * sizeof {min(arrays, key=len)}[0]"
        if source.step:
            return f"memcpy({target.pointer()}, {source.pointer()}, {size});"
        return f"memset({target.pointer()}, 0, {size});"


def _with_type(lane: Statement) -> Statement:
    lane.type = lane.type or ("float" if re.search(r"\d[\d.e-]*f\b", lane.piece.text) else "double")
    return lane


def _kind(line: CodeLine) -> str:
    match = DECLARATION.fullmatch(line.text)
    if match is not None:
        return "constant" if match.group(1) else "variable"
    return "assignment" if ASSIGNMENT.fullmatch(line.text) else ""


def _stem(line: CodeLine) -> tuple[str, str]:
    match = DECLARATION.fullmatch(line.text)
    assert match is not None
    return match.group(2), re.sub(r"(_?\d+[a-z]*|_[a-z]{1,2})$", "", match.group(3))
