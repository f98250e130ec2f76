"""Statements that are alike for all joints, as loops over arrays.

What the trace has taken apart into its numbers is put together again at the end: statements of one operation on an array
that differ in nothing but the elements that they take become the turns of a loop, and what they compute an array. No
operation is added, left out or reordered within an expression, so that nothing changes in the numbers.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence

from .in_place import passed_in_place
from ..naming import identifier
from .alike import LEAST, Access, Operands, Piece, Stored, accesses, parsed
from .layout import Line
from .writer import LETTERS

Local = dict[Access, str]
"""Numbers that live for a turn, by where they would lie, with their names."""

DECLARED = re.compile(r"(const )?(double|float|bool|u?int(?:32|64)_t) (\w+)(?: = (.*))?;")
ASSIGNED = re.compile(r"([A-Za-z_]\w*(?:->\w+)?(?:\[\d+\])?) = (.*);")


def rerolled(lines: Sequence[Line], taken: set[str]) -> list[Line]:
    """The lines with loops in them.

    - `lines`: of a function.
    - `taken`: names that are not free.
    """
    return _Rerolling(lines, taken).run()


class _Statement:
    """One line.

    - `line`: it.
    - `place`: its number in the function.
    - `type`, `name`: of what it declares; for an assignment the type is empty, and the name is where it goes.
    - `piece`: its expression.
    """

    def __init__(self, line: Line, place: int, type: str, name: str, text: str) -> None:
        self.line = line
        self.place = place
        self.type = type
        self.name = name
        self.piece: Piece = parsed(text)


class _Group:
    """Statements that are the turns of one loop, or a single one.

    - `lanes`: in order.
    - `array`: where they leave their numbers; empty for a single one that has a name of its own.
    - `at`: how each operand is found in turn i.
    - `target`: the same of where the numbers go.
    """

    def __init__(self, lanes: list[_Statement], array: str = "", at: Sequence[Access] = ()) -> None:
        self.lanes = lanes
        self.array = array
        self.at = list(at)
        self.target: Access | None = None

    @property
    def turns(self) -> int:
        return 1 if self.target is None else len(self.lanes)


class _Rerolling:
    def __init__(self, lines: Sequence[Line], taken: set[str]) -> None:
        self.lines = lines
        self.taken = taken
        self.stored: Stored = {}
        self.out: list[Line] = []
        self.used: Counter[str] = Counter()
        self.single: dict[str, _Group] = {}
        self.declared: set[str] = set()
        for line in lines:
            match = DECLARED.fullmatch(line.text)
            text = line.text if match is None else match.group(4) or ""
            self.used.update(parsed(text).operands)
        identifiers = {word for line in lines for word in re.findall(r"[A-Za-z_]\w*", line.text)} | taken
        self.index = next(name for name in ("i", "j", "k", "m", "n", "turn") if name not in identifiers)
        self.taken |= identifiers

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
        return passed_in_place([Line(line.level, self._renamed(line.text), line.about) for line in self.out])

    def _run_of(self, k: int) -> tuple[int, str]:
        """Where the lines of one kind that begin here end, and their kind."""
        kind, level = _kind(self.lines[k]), self.lines[k].level
        end = k + 1
        if kind:
            while end < len(self.lines) and self.lines[end].level == level and _kind(self.lines[end]) == kind:
                end += 1
        return end, kind

    def _renamed(self, text: str) -> str:
        return parsed(text).written(lambda word: self._place_of(word))

    def _place_of(self, word: str) -> str:
        stored = self.stored.get(word)
        return word if stored is None else f"{stored[0]}[{stored[1]}]"

    def _array(self, stem: str) -> str:
        stem = re.sub(r"_?\d+[a-z]*$", "", stem) or "v"
        stem = identifier(stem)
        name, letters = stem, iter(LETTERS)
        while name in self.taken:
            name = f"{stem}_{next(letters)}"
        self.taken.add(name)
        return name

    # ---- numbers that are computed once -----------------------------------------------------------------------------

    def _known(self, first: int, end: int) -> None:
        """Declarations of constants, in an order in which what is alike stands together."""
        statements = []
        for k in range(first, end):
            match = DECLARED.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(_Statement(self.lines[k], k, match.group(2), match.group(3), match.group(4)))
        self.single = {}
        self._place_elements(statements)
        groups = self._grouped(statements)
        self._print(self._ordered(groups), self.lines[first].level)

    def _place_elements(self, statements: list[_Statement]) -> None:
        """Gives the numbers that the source computes as an array their places in one."""
        arrays: defaultdict[tuple[int, str], list[_Statement]] = defaultdict(list)
        for one in statements:
            if one.line.element is not None:
                arrays[(one.line.element[0], one.type)].append(one)
        for those in arrays.values():
            if len(those) >= LEAST:
                array = self._array(those[0].name)
                for one in those:
                    assert one.line.element is not None
                    self.stored[one.name] = (array, one.line.element[1])

    def _grouped(self, statements: list[_Statement]) -> list[_Group]:
        alike: defaultdict[tuple[object, ...], list[_Statement]] = defaultdict(list)
        for one in statements:
            alike[(one.line.visit, one.type, one.piece.template)].append(one)
        groups: list[_Group] = []
        for (visit, _, _), lanes in alike.items():
            if visit is None or len(lanes) < LEAST:
                made = [self._alone(one) for one in lanes]
            else:
                made = self._split(lanes)
            self.single |= {group.lanes[0].name: group for group in made if group.target is None}
            groups += made
        return groups

    def _alone(self, one: _Statement) -> _Group:
        return _Group([one], self.stored[one.name][0] if one.name in self.stored else "")

    def _gather(self, lanes: list[_Statement]) -> None:
        """Puts numbers that stand alone into an array, where the turns of a loop would take one after the other."""
        for column in zip(*(one.piece.operands for one in lanes), strict=True):
            if len(set(column)) == len(column) and all(
                word in self.single and word not in self.stored for word in column
            ):
                first = self.single[column[0]].lanes[0]
                if any(self.single[word].lanes[0].type != first.type for word in column):
                    continue
                array = self._array(column[0])
                for k, word in enumerate(column):
                    self.stored[word] = (array, k)
                    self.single[word].array = array

    def _split(self, lanes: list[_Statement]) -> list[_Group]:
        """The groups that statements of one kind make: each as long as it goes, every so many of them."""
        self._gather(lanes)
        best: list[_Group] = []
        for step in (1, 2, 3):
            found: list[_Group] = []
            for offset in range(step):
                found += self._in_runs(lanes[offset::step])
            if not best or len(found) < len(best):
                best = found
        # The rows of a matrix lie one behind the other.
        array, start = "", 0
        for group in best:
            if group.target is not None and not group.array:
                array = group.array = array or self._array(group.lanes[0].name)
                group.target = Access(array, start, 1)
                for k, one in enumerate(group.lanes):
                    self.stored[one.name] = (array, start + k)
                start += len(group.lanes)
        return best

    def _in_runs(self, lanes: list[_Statement]) -> list[_Group]:
        groups = []
        k = 0
        while k < len(lanes):
            # Where the numbers go must follow a rule as well, if that is settled.
            placed = [one.name in self.stored for one in lanes[k:]]
            alike = next((n for n, one in enumerate(placed) if one != placed[0]), len(placed))
            names = [(one.name,) if placed[0] else () for one in lanes[k : k + alike]]
            rows = [(*name, *one.piece.operands) for name, one in zip(names, lanes[k : k + alike], strict=True)]
            count, at = accesses(rows, self.stored)
            if count < LEAST or (placed[0] and not at[0].step):
                groups.append(self._alone(lanes[k]))
                k += 1
                continue
            group = _Group(lanes[k : k + count], at=at[1:] if placed[0] else at)
            group.target = at[0] if placed[0] else Access("", 0, 1)
            group.array = group.target.array
            groups.append(group)
            k += count
        return groups

    def _ordered(self, groups: list[_Group]) -> list[_Group]:
        """The groups in an order in which they can be computed; one that cannot is taken apart."""
        maker = {one.name: group for group in groups for one in group.lanes}
        order: list[_Group] = []
        while True:
            missing: dict[int, set[int]] = {}
            users: defaultdict[int, list[_Group]] = defaultdict(list)
            for group in groups:
                needs = {
                    id(maker[word])
                    for one in group.lanes
                    for word in one.piece.operands
                    if word in maker
                }
                missing[id(group)] = needs
                for need in needs:
                    users[need].append(group)
            ready = [group for group in groups if not missing[id(group)]]
            order, done = [], set()
            while ready:
                group = self._next(ready, order)
                ready.remove(group)
                order.append(group)
                done.add(id(group))
                for user in users[id(group)]:
                    missing[id(user)].discard(id(group))
                    if not missing[id(user)] and id(user) not in done and user not in ready:
                        ready.append(user)
            stuck = [group for group in groups if id(group) not in done and len(group.lanes) > 1]
            if len(order) == len(groups):
                return order
            broken = min(stuck, key=lambda group: group.lanes[0].place)
            groups.remove(broken)
            for one in broken.lanes:
                single = _Group([one], broken.array)
                groups.append(single)
                maker[one.name] = single

    def _next(self, ready: list[_Group], order: list[_Group]) -> _Group:
        """What goes on best: a loop of as many turns as the last, else what came first."""
        if order and order[-1].target is not None:
            same = [group for group in ready if group.turns == order[-1].turns]
            if same:
                return min(same, key=lambda group: group.lanes[0].place)
        return min(ready, key=lambda group: (len(group.lanes) > 1, group.lanes[0].place))

    def _print(self, order: list[_Group], level: int) -> None:
        k = 0
        while k < len(order):
            group = order[k]
            if group.target is None:
                one = group.lanes[0]
                if group.array:
                    self._declare(one.type, group.array, level, one.line)
                    text = f"{group.array}[{self.stored[one.name][1]}] = {one.piece.text};"
                    self.out.append(Line(level, text, one.line.about))
                else:
                    self.out.append(one.line)
                k += 1
                continue
            together = [group]
            while k + len(together) < len(order) and _goes_on(order[k + len(together)], together):
                together.append(order[k + len(together)])
            self._loop(together, level)
            k += len(together)

    def _declare(self, type: str, array: str, level: int, line: Line) -> None:
        """Declares an array, unless that was done."""
        if array not in self.declared:
            self.declared.add(array)
            size = 1 + max(at for name, at in self.stored.values() if name == array)
            self.out.append(Line(level, f"{type} {array}[{size}];", line.about))

    def _loop(self, groups: list[_Group], level: int) -> None:
        """Writes groups of as many lanes as the turns of one loop."""
        inside: Counter[str] = Counter(word for group in groups for one in group.lanes for word in one.piece.operands)
        local: Local = {}
        for group in groups:
            if group.lanes[0].line.element is None and all(
                inside[one.name] == self.used[one.name] for one in group.lanes
            ):
                assert group.target is not None
                whole = len(group.lanes) == sum(array == group.array for array, _ in self.stored.values())
                local[group.target] = group.array if whole else self._array(group.lanes[0].name)
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
        self.out.append(Line(level, f"for (int {self.index} = 0; {self.index} < {turns}; ++{self.index}) {{", about))
        self.out += body
        self.out.append(Line(level, "}", about))

    def _operand(self, access: Access, local: Local, level: int, one: _Statement) -> str:
        if access.numbers:
            name = self._array("table")
            numbers = ", ".join(access.numbers)
            self.out.append(Line(level, f"static const {one.type} {name}[{len(access.numbers)}] = {{{numbers}}};"))
            return f"{name}[{self.index}]"
        if not access.step:
            return self._place_of(access.text)
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
        array = self._array(found[0].group(3))
        for k, match in enumerate(found):
            self.stored[match.group(3)] = (array, k)
        self.out.append(Line(line.level, f"{type} {array}[{end - first}];", line.about))
        starts = [
            _Statement(self.lines[first + k], first + k, "", f"{array}[{k}]", match.group(4))
            for k, match in enumerate(found)
            if match.group(4) is not None
        ]
        self._print_assigned(starts, line.level)

    def _assigned(self, first: int, end: int) -> None:
        statements = []
        for k in range(first, end):
            match = ASSIGNED.fullmatch(self.lines[k].text)
            assert match is not None
            statements.append(_Statement(self.lines[k], k, "", match.group(1), match.group(2)))
        self._print_assigned(statements, self.lines[first].level)

    def _print_assigned(self, statements: list[_Statement], level: int) -> None:
        """Assignments one after the other, in this very order, unless none reads what another writes."""
        written = {one.name for one in statements}
        if len(written) == len(statements) and not any(
            self._place_of(word) in written for one in statements for word in one.piece.operands
        ):
            kinds: dict[object, list[_Statement]] = {}
            for one in statements:
                arrays = tuple(self._place_of(word).partition("[")[0] for word in (one.name, *one.piece.operands))
                kinds.setdefault((one.piece.template, *arrays), []).append(one)
            statements = [one for those in kinds.values() for one in those]
        k = 0
        while k < len(statements):
            end = k + 1
            template = statements[k].piece.template
            while end < len(statements) and statements[end].piece.template == template:
                end += 1
            rows: list[Operands] = [(one.name, *one.piece.operands) for one in statements[k:end]]
            count, at = accesses(rows, self.stored)
            # A table of numbers that are written once is no shorter than the writing.
            if count < LEAST or not at[0].step:
                one = statements[k]
                self.out.append(Line(level, f"{one.name} = {one.piece.text};", one.line.about))
                k += 1
                continue
            one = statements[k]
            texts = [self._operand(access, {}, level, _typed(one)) for access in at[1:]]
            body = [Line(level + 1, f"{at[0].element(self.index)} = {one.piece.filled(texts)};")]
            self._turns(count, body, level, one.line.about)
            k += count


def _typed(one: _Statement) -> _Statement:
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


def _goes_on(group: _Group, loop: list[_Group]) -> bool:
    """Whether a group can be part of a loop: of what that computes it takes the number of its own turn."""
    if group.target is None or group.turns != loop[0].turns:
        return False
    made = {one.target for one in loop}
    places = {place for one in loop for place in _places(one.target, one.turns)}
    return all(access in made or not places & _places(access, group.turns) for access in group.at)


def _places(access: Access | None, turns: int) -> set[tuple[str, int]]:
    """The elements that are found in the turns of a loop."""
    if access is None or not access.array:
        return set()
    return {(access.array, access.start + turn * access.step) for turn in range(turns)}
