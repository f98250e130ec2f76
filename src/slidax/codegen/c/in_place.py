"""Pass arguments in place if they lie in an array already, in order, instead of a copy."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .alike import ELEMENT
from .layout import CodeLine

ARRAY_HEAD = re.compile(r"const \w+ (\w+)\[(\d+)\] = \{")


def pass_in_place(lines: Sequence[CodeLine]) -> list[CodeLine]:
    """Return the lines without arrays that copy parts of others.

    - `lines`: of a function; only the next call reads an array of elements.
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
        elements = " ".join(line.text.strip() for line in lines[k + 1 : end]).split(", ")
        pointer = _pointer(elements)
        if pointer is None:
            out += lines[k : end + 1]
        else:
            where[opened.group(1)] = pointer
        k = end + 1
    return out


def _pointer(elements: Sequence[str]) -> str | None:
    """Pointer to elements that lie one after the other, else None."""
    first = ELEMENT.fullmatch(elements[0])
    if first is None:
        return None
    array, start = first.group(1), int(first.group(2))
    if any(element != f"{array}[{start + k}]" for k, element in enumerate(elements)):
        return None
    return f"&{array}[{start}]" if start else array
