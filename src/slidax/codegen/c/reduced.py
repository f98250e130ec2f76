"""Conditions on all elements of arrays: loops and calls of `all_finite` in place of long rows of `&&` or `||`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from .alike import LEAST, Access, Piece, find_accesses, parse
from .helpers import Helpers
from .layout import INDENT, WIDTH, CodeLine

ANY_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
CONDITION = re.compile(r"((?:const bool )?[\w>\[\]-]+ = |if \(|while \()(.*)(;|\) \{)")
BOOL_DECLARATION = re.compile(r"const bool (\w+) = ")
LOOP = 4
"""Lines of a loop: its result, its head, its body, and its end."""

NewName = Callable[[str], str]
"""From a stem to a free name."""


def reduce_conditions(lines: Sequence[CodeLine], new_name: NewName, index: str, helpers: Helpers) -> list[CodeLine]:
    """Replace long conditions on array elements by loops; the conditions, which have no side effects, keep their value.

    - `new_name`: returns free names.
    - `index`: variable of the loops.
    - `helpers`: collects the called functions.
    """
    out: list[CodeLine] = []
    in_loop = False
    for line in lines:
        # Existing loops get no loops inside.
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
            out[-LOOP:] = [_rename(each, text, declared.group(1)) for each in out[-LOOP:]]
        else:
            out.append(CodeLine(line.level, before + text + after, line.about))
    return out


class _Reduction:
    def __init__(self, new_name: NewName, index: str, helpers: Helpers, line: CodeLine, *, loops: bool) -> None:
        self.new_name = new_name
        self.index = index
        self.helpers = helpers
        self.line = line
        self.loops = loops
        self.lines: list[CodeLine] = []
        # Variable of the last loop's result.
        self.result = ""

    def reduce(self, text: str) -> str:
        """Return a condition with its loops moved to `lines`."""
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
        """Terms with one operator between them; similar terms become loops."""
        kinds: dict[object, list[tuple[int, Piece]]] = {}
        short: list[str] = []
        for term in dict.fromkeys(terms):
            piece = parse(term)
            matches = [ANY_ELEMENT.fullmatch(word) for word in piece.operands]
            places = [(match.group(1), int(match.group(2))) for match in matches if match is not None]
            if not places:
                short.append(self.reduce(term))
                continue
            arrays = tuple(
                word if match is None else match.group(1) for word, match in zip(piece.operands, matches, strict=True)
            )
            kinds.setdefault((piece.template, arrays), []).append((places[0][1], piece))
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
        """The result of a loop; the condition itself where that is shorter."""
        plain = sign.join(piece.text for pieces, _ in runs for piece in pieces)
        if not self.loops or len(plain) < LOOP * (WIDTH - len(INDENT) * self.line.level):
            return plain
        name = self.new_name("some" if sign == " || " else "every")
        turn = [pieces[0].fill([_element(access, self.index) for access in at]) for pieces, at in runs]
        self.result = name
        level, about, index = self.line.level, self.line.about, self.index
        self.lines += [
            CodeLine(level, f"bool {name} = {'false' if sign == ' || ' else 'true'};", about),
            CodeLine(level, f"for (size_t {index} = 0; {index} < {count}; ++{index}) {{", about),
            CodeLine(level + 1, f"{name} = {sign.join([name, *turn])};"),
            CodeLine(level, "}", about),
        ]
        return name


def _rename(line: CodeLine, name: str, other: str) -> CodeLine:
    return CodeLine(line.level, re.sub(rf"\b{name}\b", other, line.text), line.about)


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
    """Index of the closing parenthesis."""
    depth = 0
    for k in range(opened, len(text)):
        depth += (text[k] == "(") - (text[k] == ")")
        if depth == 0:
            return k
    return -1
