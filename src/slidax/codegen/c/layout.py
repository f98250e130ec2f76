"""Lines of C: indentation, comments, line breaks, and blocks that limit the stack."""

from __future__ import annotations

import re
import textwrap
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

INDENT = "    "
WIDTH = 100
BREAKS = (", ", " + ", " - ", " * ", " && ", " || ", " ? ", " : ", " = ")
"""Texts at which a line may be broken."""

PREFERRED_BREAKS = (" && ", " || ")
"""Texts at which a line is preferably broken."""

UNINITIALISED = re.compile(r"(double|float|bool|u?int(?:32|64)_t) \w+(?:\[\d+\])?(?:, \w+(?:\[\d+\])?)*;")
"""Declaration of variables of one type without initial values."""

TOLERANCE = 10
"""Number of characters by which a line may exceed the width."""


@dataclass(frozen=True)
class CodeLine:
    """A line of generated C.

    - `level`: depth of indentation.
    - `text`: text without indentation.
    - `about`: comment on the computed value, or empty.
    - `visit`: key of the array operation in the Python source whose element the line computes; None for other lines.
    - `element`: if the declared value is an array element, the array's number and the element's index; else None.
    """

    level: int
    text: str
    about: str = ""
    visit: object = None
    element: tuple[int, int] | None = None


ELEMENT = re.compile(r"([A-Za-z_]\w*(?:->\w+)?)\[(\d+)\]")
"""An element of an array, or of a structure's array."""


def pointer_to(elements: Sequence[str]) -> str | None:
    """Return a C pointer to consecutive array elements, `&a[2]` for `a[2]`, `a[3]`, ...; None for other elements."""
    first = ELEMENT.fullmatch(elements[0])
    if first is None:
        return None
    array, start = first.group(1), int(first.group(2))
    if any(element != f"{array}[{start + k}]" for k, element in enumerate(elements)):
        return None
    return f"&{array}[{start}]" if start else array


def format_lines(lines: list[CodeLine]) -> list[str]:
    """Return lines as indented text, with long lines broken and with comments.

    Two or more successive lines with equal `about` get it as a comment above them. If a comment repeats an earlier one,
    only its text before the colon is written.
    """
    texts: list[str] = []
    last = ""
    commented: set[str] = set()
    for (about, level), group in groupby(lines, lambda line: (line.about, line.level)):
        run = list(group)
        if about and about != last and len(run) > 1:
            if texts and not texts[-1].endswith("{"):
                texts.append("")
            texts += _comment(about.partition(":")[0] if about in commented else about, level)
            commented.add(about)
            last = about
        for line in run:
            texts += _break_line(line)
    return texts


def join_declarations(lines: list[CodeLine]) -> list[CodeLine]:
    """Join adjacent declarations of the same type without initial values to one line; return all lines."""
    out: list[CodeLine] = []
    for line in lines:
        last = out[-1] if out else line
        match, before = UNINITIALISED.fullmatch(line.text), UNINITIALISED.fullmatch(last.text)
        together = match is not None and before is not None and match.group(1) == before.group(1)
        if out and together and (line.level, line.about) == (last.level, last.about):
            text = f"{last.text[:-1]}, {line.text.partition(' ')[2]}"
            if len(INDENT) * line.level + len(text) <= WIDTH:
                out[-1] = CodeLine(line.level, text, line.about)
                continue
        out.append(line)
    return out


def _break_line(line: CodeLine) -> list[str]:
    """Return a line as text, broken if it is too long."""
    text, before = line.text, INDENT * line.level
    texts: list[str] = []
    while len(before) + len(text) > WIDTH + TOLERANCE:
        width = WIDTH - len(before)
        at = max(text.rfind(mark, 0, width) for mark in PREFERRED_BREAKS)
        if at < width // 2:
            at = max(text.rfind(mark, 0, width) for mark in BREAKS)
        if at <= 0:
            break
        at += 1 if text[at] == "," else 2 if text[at + 1] == "=" else 0
        texts.append(before + text[:at])
        before, text = INDENT * (line.level + 1), text[at:].lstrip()
    return [*texts, before + text if text else ""]


def _comment(text: str, level: int) -> list[str]:
    before = INDENT * level
    # Keep the number of an equation on the line of its "eq.".
    held = re.sub(r"(eqs?\.) \(", "\\1\0(", text)
    lines = [line.replace("\0", " ") for line in textwrap.wrap(held, WIDTH - len(before) - len("/*  */"))]
    lines[0] = f"{before}/* {lines[0]}"
    lines[1:] = [f"{before} * {line}" for line in lines[1:]]
    lines[-1] += " */"
    return lines


SIZES = {"double": 8, "float": 4, "int64_t": 8, "uint64_t": 8, "int32_t": 4, "uint32_t": 4, "int": 4, "bool": 1}
VARIABLE = re.compile(rf"(const )?({'|'.join(SIZES)}) (\w+)(?:\[(\d+)\])?(?: = (.*)|;)?;?")
IDENTIFIER = re.compile(r"[A-Za-z_]\w*")
ARGUMENT = re.compile(r"\w+->\w+;?")
"""Members of a function's arguments, whose values are known from the start of the function."""

LEAST = 128
"""Least number of bytes of stack that a block must save."""


_Item = list[CodeLine]
"""A line, or the lines of a block from its head to its closing brace."""


@dataclass
class _Variable:
    """A variable of a sequence of items.

    - `first`, `last`: the items that declare it, and that use it last.
    - `fixed`: true if its declaration cannot be separated from its values.
    """

    first: int
    last: int
    bytes: int
    fixed: bool


def add_scopes(lines: Sequence[CodeLine]) -> list[CodeLine]:
    """Put blocks `{ }` around parts of a function; return all lines. Arrays of different blocks share the stack."""
    items = _items(lines)
    if len(items) < 2:
        return list(lines)
    variables = _variables(items)
    cuts = _cuts(items, variables)
    out: list[CodeLine] = []
    if len(cuts) == 2:
        return [line for item in items for line in _with_inner_scopes(item)]
    for start, end in pairwise(cuts):
        inside = [
            name
            for name, variable in variables.items()
            if start <= variable.first < end and variable.last < end and variable.bytes > 8
        ]
        if sum(variables[name].bytes for name in inside) < LEAST:
            out += [line for item in items[start:end] for line in _with_inner_scopes(item)]
            continue
        part = [line for item in items[start:end] for line in item]
        out += _block(
            part, {name for name, variable in variables.items() if start <= variable.first < end <= variable.last}
        )
    return out


def stack_bytes(lines: Sequence[CodeLine]) -> int:
    """Return a function's stack size [bytes]. An array counts until its block ends, a number while it is in use."""
    items = _items(lines)
    variables = _variables(items).values()
    arrays = sum(variable.bytes for variable in variables if variable.bytes > 8)
    most = 0
    for k, item in enumerate(items):
        alive = sum(
            variable.bytes for variable in variables if variable.bytes <= 8 and variable.first <= k <= variable.last
        )
        most = max(most, alive + _inner_bytes(item))
    return arrays + most


def _inner_bytes(item: _Item) -> int:
    """Return the stack size of the blocks in an item, of which only one is active at a time."""
    if len(item) < 3 or VARIABLE.match(item[0].text):
        return 0
    most = max((stack_bytes(part) for part, _ in _parts(item) if part), default=0)
    return most + (8 if item[0].text.startswith("for (") else 0)


def _with_inner_scopes(item: _Item) -> list[CodeLine]:
    """Return the lines of an item, with blocks added inside it."""
    if len(item) < 4 or VARIABLE.match(item[0].text):
        return item
    return [line for part, end in _parts(item) for line in (*add_scopes(part), end)]


def _parts(item: _Item) -> Iterator[tuple[list[CodeLine], CodeLine]]:
    """Yield the blocks of an item, each with the line that ends it. The first block is empty and ends with the head."""
    part: list[CodeLine] = []
    for line in item:
        if line.level == item[0].level:
            yield part, line
            part = []
        else:
            part.append(line)


def _items(lines: Sequence[CodeLine]) -> list[_Item]:
    items: list[_Item] = []
    depth = 0
    for line in lines:
        closes, opens = line.text.startswith("}"), line.text.endswith("{")
        if depth == 0 and not closes:
            items.append([])
        items[-1].append(line)
        depth += opens - closes
    return items


def _variables(items: Sequence[_Item]) -> dict[str, _Variable]:
    variables: dict[str, _Variable] = {}
    for k, item in enumerate(items):
        for name in {word for line in item for word in IDENTIFIER.findall(line.text)} & variables.keys():
            variables[name].last = k
        match = VARIABLE.match(item[0].text)
        if match is not None:
            size = SIZES[match.group(2)] * int(match.group(4) or 1)
            fixed = match.group(4) is not None and match.group(5) is not None
            variables[match.group(3)] = _Variable(k, k, size, fixed)
    return variables


def _cuts(items: Sequence[_Item], variables: Mapping[str, _Variable]) -> list[int]:
    """Choose where to cut the sequence into blocks."""
    arrays = [variable for variable in variables.values() if variable.bytes > 8]
    ends = {0, len(items)}
    candidates = {k for k in range(1, len(items)) if items[k][0].about != items[k - 1][0].about}
    candidates |= {array.first for array in arrays} | {array.last + 1 for array in arrays}
    candidates -= {k for array in arrays if array.fixed for k in range(array.first + 1, array.last + 1)}
    saved = 0
    while True:
        best, most = None, saved + LEAST
        for candidate in sorted(candidates - ends):
            gain = _saved_bytes(arrays, sorted(ends | {candidate}))
            if gain >= most:
                best, most = candidate, gain + 1
        if best is None:
            return sorted(ends)
        ends.add(best)
        saved = most - 1


def _saved_bytes(arrays: Sequence[_Variable], cuts: Sequence[int]) -> int:
    """Return the bytes of stack that blocks save: the size of all local arrays except those in the largest block."""
    local: defaultdict[int, int] = defaultdict(int)
    block = {}
    for number, (start, end) in enumerate(pairwise(cuts)):
        for k in range(start, end):
            block[k] = number
    for array in arrays:
        if block[array.first] == block.get(array.last):
            local[block[array.first]] += array.bytes
    return sum(local.values()) - max(local.values(), default=0)


def _block(lines: Sequence[CodeLine], leaving: set[str]) -> list[CodeLine]:
    """Enclose lines in a block, and declare the variables that are needed after the block before it.

    - `leaving`: names of these variables.
    """
    before: list[CodeLine] = []
    inside: list[CodeLine] = []
    level = lines[0].level
    for line in lines:
        match = VARIABLE.match(line.text)
        if match is None or match.group(3) not in leaving or line.level != level:
            inside.append(CodeLine(line.level + 1, line.text, line.about))
            continue
        _, type, name, size, value = match.groups()
        if value is not None and ARGUMENT.fullmatch(value):
            before.append(line)
            continue
        before.append(CodeLine(level, f"{type} {name}{f'[{size}]' if size else ''};"))
        if value is not None and size is None:
            inside.append(CodeLine(line.level + 1, f"{name} = {value.rstrip(';')};", line.about))
    return [*before, CodeLine(level, "{"), *add_scopes(inside), CodeLine(level, "}")]
