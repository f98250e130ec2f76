"""From templates to the files of an exported project."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from slidax.codegen.c import Dialect

from .comment_text import comment
from .members import Member


def render(template: str, values: dict[str, Any], package: str = "slidax.deploy") -> str:
    """A file's text.

    - `template`: its name.
    - `values`: what it names.
    - `package`: whose `templates` it is among.
    """
    environment = Environment(
        loader=PackageLoader(package),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"comment": comment, "capitalised": _capitalised, "wrapped": _wrapped}
    environment.globals |= {"declared": declared, "initialised": initialised, "tables": tables}
    return environment.get_template(template).render(values)


def declared(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """The lines that declare members, each with its default and meaning in a comment, those of a part together.

    - `members`: in order.
    - `dialect`: how types and numbers are written.
    """
    lines: list[str] = []
    for part, group in groupby(members, key=lambda member: member.part):
        these = list(group)
        if part:
            lines += ([""] if lines else []) + [f"/* {part} */"]
        names = [f"{dialect.type(member.type)} {member.name}{member.brackets};" for member in these]
        width = max(map(len, names))
        for name, member in zip(names, these, strict=True):
            words = [default(member, dialect), member.meaning]
            said = ": ".join(word for word in words if word)
            lines.append(f"{name:<{width}} /* {said} */" if said else name)
    return lines


def initialised(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """The lines that give members their defaults where a structure is declared.

    - `members`: with defaults.
    - `dialect`: how numbers are written.
    """
    lines: list[str] = []
    for member in members:
        if member.values is None:
            continue
        numbers = [_number(number, member, dialect) for number in member.values.ravel()]
        if not member.shape:
            lines.append(f".{member.name} = {numbers[0]},")
        else:
            rows = textwrap.wrap(f".{member.name} = {{{', '.join(numbers)}}},", 100, break_long_words=False)
            lines += [rows[0], *(f"    {row}" for row in rows[1:])]
    return lines


def tables(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """The lines that define arrays of known numbers.

    - `members`: with their numbers.
    - `dialect`: how types and numbers are written.
    """
    lines: list[str] = []
    for member in members:
        assert member.values is not None
        numbers = ", ".join(_number(number, member, dialect) for number in member.values.ravel())
        lines.append(f"static const {dialect.type(member.type)} {member.name}[{member.size}] = {{")
        lines += [f"    {row}" for row in textwrap.wrap(numbers, 100, break_long_words=False)]
        lines += ["};", ""]
    return lines


def default(member: Member, dialect: Dialect) -> str:
    """A member's default, as short as it can be said; empty if it has none.

    - `member`: the member.
    - `dialect`: how numbers are written.
    """
    if member.values is None:
        return ""
    numbers = ["none" if np.isposinf(number) else _number(number, member, dialect) for number in member.values.ravel()]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)


def _number(number: Any, member: Member, dialect: Dialect) -> str:
    return dialect.number(number.item(), member.type)


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _wrapped(text: str, before: str, width: int = 116) -> str:
    """A paragraph, each line after the first with what stands before it."""
    return f"\n{before}".join(textwrap.wrap(text, width - len(before)))
