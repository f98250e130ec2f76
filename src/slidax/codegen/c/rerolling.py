"""Write similar statements for all joints as loops over arrays."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from .arrays import Arrays, AssignmentRun, runs_of
from .expressions import Helpers
from .layout import INDENT, WIDTH, CodeLine, pointer_to
from .similar import LEAST, Access, Group, Piece, Statement, find_accesses, fits_loop, order_groups, parse

ARRAY_HEAD = re.compile(r"const \w+ (\w+)\[(\d+)\] = \{")


def pass_in_place(lines: Sequence[CodeLine]) -> list[CodeLine]:
    """Remove arrays that copy consecutive elements of another array, and pass a pointer to these instead.

    Returns the new lines.

    - `lines`: lines of a function, in which only the call that follows such an array reads it.
    """
    out: list[CodeLine] = []
    where: dict[str, str] = {}
    k = 0
    while k < len(lines):
        opened = ARRAY_HEAD.fullmatch(lines[k].text)
        if opened is None:
            line = lines[k]
            words = [word for word in where if word in line.text]
            text = line.text
            for word in words:
                text = re.sub(rf"\b{word}\b", where[word], text)
            out.append(line if text == line.text else CodeLine(line.level, text, line.about))
            k += 1
            continue
        end = next(n for n in range(k, len(lines)) if lines[n].text == "};")
        pointer = pointer_to(" ".join(line.text.strip() for line in lines[k + 1 : end]).split(", "))
        if pointer is None:
            out += lines[k : end + 1]
        else:
            where[opened.group(1)] = pointer
        k = end + 1
    return out


ANY_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
CONDITION = re.compile(r"((?:const bool )?[\w>\[\]-]+ = |if \(|while \()(.*)(;|\) \{)")
BOOL_DECLARATION = re.compile(r"const bool (\w+) = ")
LOOP = 4
"""Number of lines of a loop for a condition: result, head, body, end."""

NewName = Callable[[str], str]
"""Map a stem to a free name."""


def reduce_conditions(lines: Sequence[CodeLine], new_name: NewName, index: str, helpers: Helpers) -> list[CodeLine]:
    """Replace long conditions on array elements by loops that compute the same values; return the new lines.

    - `new_name`: function from a stem to an unused name.
    - `index`: name of the loops' counter.
    - `helpers`: collects the helper functions that the new lines call.
    """
    out: list[CodeLine] = []
    in_loop = False
    for line in lines:
        # No loops are added inside existing loops.
        in_loop = line.text.startswith(f"for (size_t {index} ") or (in_loop and line.text != "}")
        match = CONDITION.fullmatch(line.text)
        if match is None or not (" && " in line.text or " || " in line.text):
            out.append(line)
            continue
        before, text, after = match.groups()
        # The condition of a loop stays in its head.
        reduction = _Reduction(new_name, index, helpers, line, loops=not in_loop and before != "while (")
        text = reduction.reduce(text)
        out += reduction.lines
        declared = BOOL_DECLARATION.fullmatch(before)
        if declared is not None and reduction.lines and text == reduction.result:
            # The loop computes just this variable.
            renamed = [re.sub(rf"\b{text}\b", declared.group(1), each.text) for each in out[-LOOP:]]
            out[-LOOP:] = [CodeLine(e.level, new, e.about) for e, new in zip(out[-LOOP:], renamed, strict=True)]
        else:
            out.append(CodeLine(line.level, before + text + after, line.about))
    return out


@dataclass
class _Reduction:
    """The reduction of one condition.

    - `loops`: True if loops may be added.
    - `result`: variable with the result of the last loop that was added.
    """

    new_name: NewName
    index: str
    helpers: Helpers
    line: CodeLine
    loops: bool
    lines: list[CodeLine] = field(default_factory=list)
    result: str = ""

    def reduce(self, text: str) -> str:
        """Return a condition in which the results of loops replace its long parts; the loops are added to `lines`."""
        if _split(text, " ? ")[1:]:
            return text
        for sign in (" || ", " && "):
            terms = _split(text, sign)
            if len(terms) > 1:
                return self._join(terms, sign)
        for before in ("!(", "("):
            if text.startswith(before) and _closing_parenthesis(text, len(before) - 1) == len(text) - 1:
                inner = self.reduce(text[len(before) : -1])
                return before.rstrip("(") + inner if inner.isidentifier() else f"{before}{inner})"
        return text

    def _join(self, terms: list[str], sign: str) -> str:
        """Join terms by an operator; similar terms become loops."""
        kinds: dict[object, list[tuple[int, Piece]]] = {}
        short: list[str] = []
        for term in dict.fromkeys(terms):
            piece = parse(term)
            matches = [ANY_ELEMENT.fullmatch(word) for word in piece.operands]
            elements = [(match.group(1), int(match.group(2))) for match in matches if match is not None]
            if not elements:
                short.append(self.reduce(term))
                continue
            arrays = tuple(
                word if match is None else match.group(1) for word, match in zip(piece.operands, matches, strict=True)
            )
            kinds.setdefault((piece.template, arrays), []).append((elements[0][1], piece))
        loops: dict[int, list[tuple[list[Piece], list[Access]]]] = {}
        for those in kinds.values():
            pieces = [piece for _, piece in sorted(those, key=lambda pair: pair[0])]
            k = 0
            while k < len(pieces):
                rows = [piece.operands for piece in pieces[k:]]
                count, at = find_accesses(rows, {})
                if count < LEAST or any(access.numbers for access in at):
                    short.append(self.reduce(pieces[k].text))
                    k += 1
                    continue
                if at[-1].step == 1 and pieces[k].text == f"isfinite({pieces[k].operands[-1]})" and sign == " && ":
                    self.helpers.name_of("all_finite", "f64")
                    short.append(f"all_finite({at[-1].pointer()}, {count})")
                else:
                    loops.setdefault(count, []).append((pieces[k : k + count], at))
                k += count
        for count, runs in loops.items():
            short.append(self._loop(count, runs, sign))
        return sign.join(short)

    def _loop(self, count: int, runs: list[tuple[list[Piece], list[Access]]], sign: str) -> str:
        """Add a loop and return the name of its result; return the condition itself if it is shorter."""
        plain = sign.join(piece.text for pieces, _ in runs for piece in pieces)
        if not self.loops or len(plain) < LOOP * (WIDTH - len(INDENT) * self.line.level):
            return plain
        name = self.new_name("some" if sign == " || " else "every")
        terms = [pieces[0].fill([_element(access, self.index) for access in at]) for pieces, at in runs]
        self.result = name
        level, about, index = self.line.level, self.line.about, self.index
        self.lines += [
            CodeLine(level, f"bool {name} = {'false' if sign == ' || ' else 'true'};", about),
            CodeLine(level, f"for (size_t {index} = 0; {index} < {count}; ++{index}) {{", about),
            CodeLine(level + 1, f"{name} = {sign.join([name, *terms])};"),
            CodeLine(level, "}", about),
        ]
        return name


def _element(access: Access, index: str) -> str:
    return access.element(index) if access.step else access.text


def _split(text: str, sign: str) -> list[str]:
    """Split a text at all operators outside parentheses."""
    parts, depth, start, k = [], 0, 0, 0
    while k < len(text):
        depth += (text[k] == "(") - (text[k] == ")")
        if depth == 0 and text.startswith(sign, k):
            parts.append(text[start:k])
            k = start = k + len(sign)
            continue
        k += 1
    return [*parts, text[start:]]


def _closing_parenthesis(text: str, opened: int) -> int:
    """Return the index of the closing parenthesis."""
    depth = 0
    for k in range(opened, len(text)):
        depth += (text[k] == "(") - (text[k] == ")")
        if depth == 0:
            return k
    return -1


Local = dict[Access, str]
"""Names of values that are needed in one iteration only, by the rule for their array element."""

DECLARATION = re.compile(r"(const )?(double|float|bool|u?int(?:32|64)_t) (\w+)(?: = (.*))?;")
ASSIGNMENT = re.compile(r"([A-Za-z_]\w*(?:->\w+)?(?:\[\d+\])?) = (.*);")


def reroll(lines: Sequence[CodeLine], taken: set[str], helpers: Helpers) -> list[CodeLine]:
    """Return the lines of a function with similar statements written as loops.

    - `taken`: names in use.
    - `helpers`: collects the helper functions that the new lines call.
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
        pieces = [parse(line.text) for line in self.out]
        texts = [piece.fill([self.arrays.read(word) for word in piece.operands]) for piece in pieces]
        renamed = [CodeLine(line.level, text, line.about) for line, text in zip(self.out, texts, strict=True)]
        return reduce_conditions(pass_in_place(renamed), self.arrays.new_name, self.index, self.helpers)

    def _run_of(self, k: int) -> tuple[int, str]:
        """Return the end and the kind of the run of similar lines that begins at line k."""
        kind, level = _kind(self.lines[k]), self.lines[k].level
        end = k + 1
        if kind:
            while end < len(self.lines) and self.lines[end].level == level and _kind(self.lines[end]) == kind:
                end += 1
        return end, kind

    # ---- constants ---------------------------------------------------------------------------------------------------

    def _constants(self, first: int, end: int) -> None:
        """Print declarations of constants, similar ones next to each other."""
        statements = []
        for k in range(first, end):
            match = DECLARATION.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(Statement(self.lines[k], k, match.group(2), match.group(3), parse(match.group(4))))
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
                is_full = len(group.lanes) == sum(array == group.array for array, _ in self.arrays.stored.values())
                local[group.target] = group.array if is_full else self.arrays.new_name(group.lanes[0].name)
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
        self._print_loop(groups[0].iterations, body, level, about)

    def _print_loop(self, iterations: int, body: list[CodeLine], level: int, about: str) -> None:
        self.out.append(
            CodeLine(level, f"for (size_t {self.index} = 0; {self.index} < {iterations}; ++{self.index}) {{", about)
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
        """Print declarations of variables; those with the same stem become an array."""
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
            Statement(self.lines[first + k], first + k, "", f"{array}[{k}]", parse(match.group(4)))
            for k, match in enumerate(variables)
            if match.group(4) is not None
        ]
        self._print_assignments(starts, line.level)

    def _assignments(self, first: int, end: int) -> None:
        statements = []
        for k in range(first, end):
            match = ASSIGNMENT.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(Statement(self.lines[k], k, "", match.group(1), parse(match.group(2))))
        self._print_assignments(statements, self.lines[first].level)

    def _print_assignments(self, statements: list[Statement], level: int) -> None:
        """Print assignments in an order that does not change any value."""
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
        """Return a `memcpy` between parts of two arrays, or a `memset` that sets a part to zero."""
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
